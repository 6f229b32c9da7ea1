"""Shapes of classes made of simple forms, photographed from a little above: round things, boxes, tools, flat fish.

    python benchmarks/forms.py --out RESULTS --minutes 10
    python benchmarks/forms.py --out RESULTS --classes mug lamp --seeds 0 1 --flags rectilinear=0

Of each class 240 objects are made, and of each object one cut-out, a PNG of 160² pixels: a perspective camera at a
distance of four times the object's radius, any azimuth, 14° ± 6° above the horizon. Forty more are the reference.
An arm is a class, a seed and some flags, and is trained on one thread for some minutes of CPU time, nothing but the
folder given. It is scored by

    MMD         mean 1 - IoU of a held-out shape to the nearest sample, all at one size, over that of the 240 shapes
    plan        median log(X Z / 4 A) of samples as seen from above (`up.Rectilinear`): rectangles 0, discs 0.24
    sides       median over samples of the longer over the shorter side of the plan: 1 if round
    verdict     which knows none of these

A line of JSON an arm is written to RESULTS/results.jsonl and a sheet of twelve samples beside it; an arm that is there
with the same minutes is left out.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from any_class import trained
from PIL import Image, ImageDraw
from results import Results, count_cpu_seconds
from scipy.spatial import ConvexHull
from torch import Tensor

import unproject as up
from unproject.metrics import shape_scores
from unproject.ops import unit_sized

OBJECTS, HELD_OUT, PIXELS, SUPERSAMPLED, SIZE, BINS = 240, 40, 160, 4, 32, 16
ELEVATION, SPREAD, DISTANCE = 14.0, 6.0, 4.0
Part: TypeAlias = np.ndarray
"""The corners (N, 3) of a convex part; y is up."""
Random: TypeAlias = np.random.Generator


def box(centre: Sequence[float], sides: Sequence[float]) -> Part:
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
    return np.asarray(centre) + corners * np.asarray(sides)


def frustum(low: float, high: float, bottom: float, top: float, x: float = 0.0, z: float = 0.0) -> Part:
    """A cone's part around a vertical axis, of radius `bottom` at the height `low` and `top` at `high`."""
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.stack([np.cos(angle), np.zeros(48), np.sin(angle)], 1)
    return np.concatenate([ring * r + [x, y, z] for y, r in ((low, bottom), (high, top))])


def turned(profile: Sequence[tuple[float, float]]) -> list[Part]:
    """A body of revolution, whose radius at heights is given, in convex slices."""
    return [frustum(a[0], b[0], a[1], b[1]) for a, b in zip(profile[:-1], profile[1:], strict=True)]


def rod(start: Sequence[float], end: Sequence[float], radius: float) -> Part:
    """Two octahedra and what lies between."""
    ends = np.concatenate([np.eye(3), -np.eye(3)]) * radius
    return np.concatenate([np.asarray(start) + ends, np.asarray(end) + ends])


def path(points: Sequence[Sequence[float]], radius: float) -> list[Part]:
    return [rod(a, b, radius) for a, b in zip(points[:-1], points[1:], strict=True)]


def mug(rng: Random) -> list[Part]:
    r, h, way = rng.uniform(0.3, 0.5), rng.uniform(0.7, 1.1), rng.uniform(0.85, 1.1)
    turns = np.linspace(-np.pi / 2, np.pi / 2, 9)
    out, tall = rng.uniform(0.2, 0.35), h * rng.uniform(0.25, 0.35)
    handle = [(0.9 * r + out * np.cos(t), h / 2 + tall * np.sin(t), 0.0) for t in turns]
    return [frustum(0, h, r * way, r), *path(handle, 0.05)]


def lamp(rng: Random) -> list[Part]:
    base, pole = rng.uniform(0.2, 0.4), rng.uniform(0.5, 1.0)
    wide, tall, narrow = rng.uniform(0.3, 0.55), rng.uniform(0.3, 0.5), rng.uniform(0.5, 1.0)
    return [
        frustum(0, 0.08, base, base),
        frustum(0.08, pole, 0.05, 0.05),
        frustum(pole, pole + tall, wide, narrow * wide),
    ]


def hammer(rng: Random) -> list[Part]:
    long, head, thick = rng.uniform(0.9, 1.3), rng.uniform(0.4, 0.6), rng.uniform(0.14, 0.2)
    claw = rng.uniform(0.5, 1.0)
    return [
        box((0, long / 2, 0), (0.1, long, 0.08)),
        box((head * 0.2, long, 0), (head * 0.6, thick, thick)),
        rod((-0.1, long + 0.02, 0), (-0.1 - claw * head * 0.6, long - 0.1, 0), 0.05),
    ]


def drawers(rng: Random) -> list[Part]:
    w, d, h, leg = rng.uniform(0.5, 1.0), rng.uniform(0.35, 0.5), rng.uniform(0.6, 1.1), rng.uniform(0.06, 0.25)
    legs = [box((x * (w / 2 - 0.04), leg / 2, z * (d / 2 - 0.04)), (0.08, leg, 0.08)) for x in (-1, 1) for z in (-1, 1)]
    return [*legs, box((0, leg + h / 2, 0), (w, h, d)), box((0, leg + h + 0.02, 0), (w + 0.08, 0.05, d + 0.08))]


def bottle(rng: Random) -> list[Part]:
    r, body = rng.uniform(0.22, 0.42), rng.uniform(0.5, 0.9)
    neck, shoulder, tall = rng.uniform(0.07, 0.13), rng.uniform(0.1, 0.3), rng.uniform(0.15, 0.4)
    top = body + shoulder + tall
    return turned([(0, 0.95 * r), (0.05, r), (body, r), (body + shoulder, neck), (top, neck)])


def goblet(rng: Random) -> list[Part]:
    foot, stem, r, tall = rng.uniform(0.2, 0.35), rng.uniform(0.2, 0.6), rng.uniform(0.25, 0.45), rng.uniform(0.3, 0.6)
    lip = rng.uniform(0.75, 1.1)
    low = 0.05 + stem
    bowl = [(low, 0.05), (low + 0.25 * tall, 0.8 * r), (low + 0.5 * tall, r), (low + tall, lip * r)]
    return turned([(0, foot), (0.04, foot), (0.06, 0.04), (low, 0.05), *bowl[1:]])


def radio(rng: Random) -> list[Part]:
    w, d, h = rng.uniform(0.7, 1.2), rng.uniform(0.2, 0.4), rng.uniform(0.4, 0.7)
    rise, aerial = rng.uniform(0.08, 0.2), rng.uniform(0.3, 0.6)
    grip = [(-0.35 * w, h, 0), (-0.35 * w, h + rise, 0), (0.35 * w, h + rise, 0), (0.35 * w, h, 0)]
    feet = [box((x * 0.4 * w, 0.03, 0), (0.1, 0.06, 0.8 * d)) for x in (-1, 1)]
    tip = (0.45 * w + 0.3 * aerial, h + aerial, -0.3 * d)
    return [*feet, box((0, 0.06 + h / 2, 0), (w, h, d)), *path(grip, 0.04), rod((0.45 * w, h, -0.3 * d), tip, 0.025)]


def bus(rng: Random) -> list[Part]:
    long, wide, high = rng.uniform(1.3, 2.2), rng.uniform(0.5, 0.6), rng.uniform(0.5, 0.8)
    cab = rng.uniform(0.15, 0.35)
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    wheel = np.stack([np.cos(angle), np.sin(angle)], 1) * 0.13
    wheels = [
        np.concatenate([np.insert(wheel + [x * long * 0.33, 0.13], 2, z * wide * k, axis=1) for k in (0.35, 0.5)])
        for x in (-1, 1)
        for z in (-1, 1)
    ]
    hood = box((-long / 2 - cab / 2 + 0.02, 0.14 + high * 0.25, 0), (cab, high * 0.5, wide * 0.9))
    return [*wheels, box((0, 0.14 + high / 2, 0), (long, high, wide)), hood]


def teapot(rng: Random) -> list[Part]:
    r, h = rng.uniform(0.35, 0.5), rng.uniform(0.45, 0.75)
    body = turned([(0, 0.6 * r), (0.2 * h, 0.9 * r), (0.45 * h, r), (0.75 * h, 0.85 * r), (h, 0.4 * r)])
    knob = frustum(h, h + 0.12, 0.07, 0.09)
    spout = path([(-0.9 * r, 0.3 * h, 0), (-1.4 * r, 0.6 * h, 0), (-1.6 * r, h, 0)], 0.07)
    grip = path([(0.8 * r, 0.8 * h, 0), (1.5 * r, 0.75 * h, 0), (1.5 * r, 0.35 * h, 0), (0.9 * r, 0.25 * h, 0)], 0.05)
    return [*body, knob, *spout, *grip]


def stool(rng: Random) -> list[Part]:
    """A round seat on three or four legs."""
    r, h, n = rng.uniform(0.25, 0.45), rng.uniform(0.6, 1.1), int(rng.integers(3, 5))
    splay = rng.uniform(0.8, 1.2)
    ways = [(r * np.cos(t), r * np.sin(t)) for t in 2 * np.pi * np.arange(n) / n + np.pi / 4]
    legs = [rod((splay * x, 0.04, splay * z), (0.6 * x, h, 0.6 * z), 0.04) for x, z in ways]
    return [*legs, frustum(h, h + 0.08, r, r)]


def fish(rng: Random) -> list[Part]:
    """Flat, and longer than high: a body, a tail and a fin."""
    long, high = rng.uniform(0.8, 1.3), rng.uniform(0.35, 0.6)
    thick, tail, fin = high * rng.uniform(0.25, 0.5), high * rng.uniform(0.6, 1.1), rng.uniform(0.1, 0.25)
    rise, around = np.linspace(-np.pi / 2, np.pi / 2, 13)[:, None], np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ball = np.stack(np.broadcast_arrays(np.cos(rise) * np.cos(around), np.sin(rise), np.cos(rise) * np.sin(around)), -1)
    body = ball.reshape(-1, 3) * [long / 2, high / 2, thick / 2]
    ends = [(-0.45 * long, 0.05), (-0.45 * long, -0.05), (-0.75 * long, tail / 2), (-0.75 * long, -tail / 2)]
    tops = [(-0.2 * long, 0.4 * high), (0.15 * long, 0.45 * high), (-0.2 * long, high / 2 + fin)]
    flat = [np.array([(x, y, z) for x, y in corners for z in (-0.02, 0.02)]) for corners in (ends, tops)]
    return [body, *flat]


CLASSES: dict[str, Callable[[Random], list[Part]]] = {
    made.__name__: made for made in (mug, lamp, hammer, drawers, bottle, goblet, radio, bus, teapot, stool, fish)
}
CHOSEN_ON = ("mug", "lamp", "hammer", "drawers", "fish")
"""Classes that methods were chosen on; the others are run once, with what was chosen."""


def objects(name: str, n: int, seed: int) -> list[list[Part]]:
    """Return n objects of a class, each with its centre at the origin and of radius 1."""
    rng = np.random.default_rng((seed, *name.encode()))
    made = []
    for _ in range(n):
        parts = CLASSES[name](rng)
        corners = np.concatenate(parts)
        middle = (corners.min(0) + corners.max(0)) / 2
        radius = np.linalg.norm(corners - middle, axis=1).max()
        made.append([(part - middle) / radius for part in parts])
    return made


def cut_out(parts: list[Part], azimuth: float, elevation: float) -> Image.Image:
    """Return the mask of an object, cropped to its box: each convex part is the hull of its projected corners."""
    side = PIXELS * SUPERSAMPLED
    picture = Image.new("L", (side, side))
    draw = ImageDraw.Draw(picture)
    a, e = math.radians(azimuth), math.radians(elevation)
    right = np.array([math.cos(a), 0, -math.sin(a)])
    towards = np.array([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)])
    above = np.cross(towards, right)
    for part in parts:
        near = DISTANCE - part @ towards
        flat = np.stack([part @ right, -(part @ above)], 1) * (DISTANCE / near)[:, None]
        flat = flat[ConvexHull(flat, qhull_options="QJ").vertices]
        draw.polygon([(float(x), float(y)) for x, y in (flat * 0.45 + 0.5) * side], fill=255)
    small = picture.resize((PIXELS, PIXELS), Image.Resampling.BOX).point(lambda v: 255 * (v > 127))
    return small.crop(small.getbbox())


def voxels(parts: list[Part], size: int = SIZE) -> Tensor:
    """Return the occupancy (size, size, size) at twice as many points a side, averaged."""
    line = (np.arange(2 * size) + 0.5) / size - 1
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)
    inside = np.zeros(len(points), dtype=bool)
    for part in parts:
        near = np.nonzero(((points >= part.min(0)) & (points <= part.max(0))).all(1))[0]
        planes = ConvexHull(part, qhull_options="QJ").equations
        inside[near] |= (points[near] @ planes[:, :3].T + planes[:, 3] <= 1e-6).all(1)
    fine = torch.from_numpy(inside).reshape(1, 1, *[2 * size] * 3).float()
    return torch.nn.functional.avg_pool3d(fine, 2)[0, 0]


def prepare(name: str, out: Path) -> Path:
    """Make the cut-outs and the true shapes of a class once; return its folder."""
    folder = out / "data" / name
    if (folder / "truth.pt").exists():
        return folder
    (folder / "cut-outs").mkdir(parents=True, exist_ok=True)
    train, test = objects(name, OBJECTS, 0), objects(name, HELD_OUT, 1)
    rng = np.random.default_rng((2, *name.encode()))
    for i, parts in enumerate(train):
        mask = cut_out(parts, rng.uniform(0, 360), rng.normal(ELEVATION, SPREAD))
        padded = Image.new("L", (mask.width + 8, mask.height + 8))
        padded.paste(mask, (4, 4))
        padded.save(folder / "cut-outs" / f"{i:05d}.png")
    truth = {key: torch.stack([voxels(parts) for parts in some]) for key, some in (("train", train), ("test", test))}
    torch.save(truth, folder / "truth.pt")
    return folder


def plan_of(x: Tensor) -> dict[str, float]:
    """Return the medians of log(X Z / 4 A) and of the ratio of sides of the plans of volumes (N, X, Y, Z)."""
    plan = torch.nn.functional.pad((x > 0.5).float().amax(2), (1, 1, 1, 1))
    along_x, along_z = (plan.diff(dim=axis).abs().flatten(1).sum(1).clamp_min(1) for axis in (1, 2))
    area = plan.flatten(1).sum(1).clamp_min(1)
    sides = torch.maximum(along_x / along_z, along_z / along_x)
    return {"plan": (along_x * along_z / (4 * area)).log().median().item(), "sides": sides.median().item()}


def thickness_of(x: Tensor) -> float:
    """Return the median over volumes (N, X, Y, Z) of t / d, of the axis, x or z, along which they are thinner.

    Of a volume it is the median over places that look d voxels wide along the axis (`ops.local_widths`), at least
    three, and are t thick there, from the first to the last voxel.
    """
    both = ((thin_along(full), thin_along(full.transpose(0, 2))) for full in x > 0.5)
    return torch.stack([torch.minimum(*one) for one in both]).median().item()


def thin_along(full: Tensor) -> Tensor:
    """Return the median of t / d of a volume (X, Y, Z) along x; infinity if it is nowhere three voxels wide."""
    extent = (full.cumsum(0) > 0) & (full.flip(0).cumsum(0).flip(0) > 0)
    width = up.ops.local_widths(full.any(0)[None].float())[0]
    wide = width >= 3
    return (extent.sum(0)[wide] / width[wide]).median() if wide.any() else torch.tensor(math.inf)


def run_arm(name: str, seed: int, minutes: float, flags: dict[str, Any], out: Path, label: str) -> dict[str, Any]:
    """Train and score one arm."""
    folder = prepare(name, out)
    recipe = up.recipes.find("shapes")(data=folder / "cut-outs", seed=seed, minutes=minutes, **flags)
    called = f"{name}-{label}-{minutes:g}-{seed}"
    run, found = trained(recipe, out / "runs" / called)
    truth = torch.load(folder / "truth.pt")
    train, test = unit_sized(truth["train"]), unit_sized(truth["test"])
    x = run.sample(len(train), seed=1)
    if x.shape[-1] != SIZE:
        x = torch.nn.functional.interpolate(x[:, None], (SIZE,) * 3, mode="area")[:, 0]
    scores = shape_scores(unit_sized(x), test, selection=train[:100], bins=BINS)
    own = shape_scores(train, test, bins=None)
    verdict = run.verdict()
    up.export.contact_sheet(run.sample(12, seed=1), out / f"{called}.png", size=80)
    return {
        **found,
        "mmd_ratio": scores["mmd_iou"].value / own["mmd_iou"].value,
        "cov_ratio": scores["cov_iou"].value / own["cov_iou"].value,
        **plan_of(unit_sized(x)),
        "thickness": thickness_of(x),
        "true_thickness": thickness_of(train),
        **{f"true_{key}": value for key, value in plan_of(train).items()},
        "verdict": verdict.word,
        "says": verdict.line,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=list(CLASSES))
    parser.add_argument("--seeds", nargs="+", type=int, default=(0,))
    parser.add_argument("--flags", nargs="*", default=(), metavar="NAME=NUMBER", help="of the recipe, beside --data")
    given = parser.parse_args()
    torch.set_num_threads(1)
    count_cpu_seconds()
    flags = {name: json.loads(value) for name, value in (flag.split("=") for flag in given.flags)}
    label = "-".join(given.flags) or "default"
    results = Results(given.out / "results.jsonl", ("class", "flags", "seed", "budget"))
    for seed in given.seeds:
        for name in given.classes:
            if not results.has(name, label, seed, given.minutes):
                found = run_arm(name, seed, given.minutes, flags, given.out, label)
                results.add({"class": name, "flags": label, "seed": seed, "budget": given.minutes, **found})


if __name__ == "__main__":
    main()
