"""Shapes of nine classes from their silhouettes, with one set of default flags: how near they come, and to what.

    python benchmarks/any_class.py --data SHARED --out RESULTS --minutes 20         # all arms, one after another
    python benchmarks/any_class.py --data SHARED --out RESULTS --classes chair bed --seeds 0 --minutes 5

SHARED holds shapes3d/ with seven ModelNet classes (solid voxels), 18 birds and 17 cars (meshes). Of each class at most
200 training shapes are rendered, 16 silhouettes each (64 of birds and cars), binary, 64 pixels a side, at azimuths
uniform around the circle. An arm is a class, a form, views and a seed:

    cropped   a folder of PNGs, each cropped to its object by itself, views unknown: nothing but --data is given
    plain     the same silhouettes as they are, in an .npz, views unknown
    known     the same .npz with the azimuths

Each arm trains `shapes` on one thread for some minutes of CPU time, so that it matters little what runs beside, and is
scored against held-out shapes: MMD and COV (1 - IoU, all shapes at one size, the gauge chosen on training shapes) over
those of as many training shapes; MMD also of samples as they are exported (near parts joined, others removed), and to
those held-out shapes alone of which there is no copy among the training shapes (IoU above 0.9, as ModelNet has many);
the same of the visual hulls of training shapes, the best that level silhouettes can tell; the accuracy of views over
that of a predictor trained on the true ones; the share of shapes in one piece; the verdict, which knows none of these.
A line of JSON an arm is written to RESULTS/results.jsonl, an arm that is there with the same minutes and training
shapes is left out, the table is printed at the end.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from results import Results, budget_of, count_cpu_seconds, finished, minutes_of
from torch import Tensor

import unproject as up
from unproject.data.readers.shapes import normalised
from unproject.data.readers.voxelise import voxelise
from unproject.metrics import shape_scores, view_accuracy
from unproject.ops import unit_sized, visual_hull
from unproject.training.evaluation import supervised_ceiling

MODELNET = ("bathtub", "bed", "chair", "desk", "dresser", "night_stand", "table")
CLASSES = (*MODELNET, "bird", "car")
CHOSEN_ON = ("bed", "chair", "car", "table")
"""Classes that methods were chosen on; the others are run once, with what was chosen."""
FORMS = ("cropped", "plain", "known")
RENDERED, SIZE, SHAPES, BINS = 64, 32, 200, 16
UNLIKE_CARS = ("kart", "tractor")
COPY = 0.9
"""IoU above which a training shape is a copy."""


def volumes_of(name: str, data: Path, shapes: int = SHAPES) -> tuple[Tensor, Tensor]:
    """Return training volumes, at most so many, and held-out ones (N, 64, 64, 64) of a class."""
    if name in MODELNET:
        archive = data / "shapes3d" / "modelnet7_vox30_packbits.npz"
        splits = [up.Collection.volumes(f"{archive}:{name}/{split}", size=RENDERED) for split in ("train", "test")]
        rng = torch.Generator().manual_seed(7)
        rows = [
            torch.randperm(len(split), generator=rng)[:most].sort().values
            for split, most in zip(splits, (shapes, 100), strict=True)
        ]
        return splits[0].batch(rows[0]), splits[1].batch(rows[1])
    meshes = birds(data) if name == "bird" else cars(data)
    solids = torch.stack([torch.from_numpy(voxelise(normalised(v), f, RENDERED)).float() for v, f in meshes])
    held_out = torch.arange(len(solids)) % 4 == 3
    return solids[~held_out], solids[held_out]


def birds(data: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (vertices, faces) of each bird, turned so that y is up."""
    stored = np.load(data / "shapes3d" / "birds18_aves_meshes.npz")
    return [(v.astype(float)[:, [0, 2, 1]] * np.array([1, 1, -1]), stored["faces"]) for v in stored["verts"]]


def cars(data: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (vertices, faces) of each vehicle that is neither a kart nor a tractor."""
    stored = np.load(data / "shapes3d" / "cars_kenney_cc0_meshes.npz")
    found = []
    for i, name in enumerate(stored["name"]):
        vertices = stored["verts"][stored["vert_start"][i] : stored["vert_start"][i + 1]].astype(float)
        faces = stored["faces"][stored["face_start"][i] : stored["face_start"][i + 1]]
        if not any(word in str(name) for word in UNLIKE_CARS):
            found.append((vertices, faces - faces.min()))
    return found


def prepare(name: str, data: Path, out: Path, shapes: int = SHAPES) -> Path:
    """Render silhouettes of at most so many shapes of a class once; return its folder."""
    folder = out / "data" / f"{name}-{shapes}"
    if (folder / "truth.pt").exists():
        return folder
    (folder / "cropped").mkdir(parents=True, exist_ok=True)
    train, test = volumes_of(name, data, shapes)
    views = up.projections.azimuth_bins(BINS, up.Silhouette(size=RENDERED))
    seen = up.data.observe(train, views, 16 if len(train) > 50 else 64, seed=3, binary=True, chunk=16)
    masks = seen.floats()[:, 0].numpy() > 0.5
    large = np.array([max(np.ptp(np.nonzero(m)[k]) if m.any() else 0 for k in (0, 1)) >= 8 for m in masks])
    masks, azimuth = masks[large], seen.latents["azimuth"].numpy()[large] if seen.latents else np.zeros(0)
    np.savez_compressed(folder / "plain.npz", sil=masks)
    np.savez_compressed(folder / "known.npz", sil=masks, azimuth=azimuth)
    for i, mask in enumerate(masks):
        cropped = up.data.frame(mask.astype(np.float32), RENDERED).image[0].numpy() >= 0.5
        Image.fromarray(cropped.astype(np.uint8) * 255).save(folder / "cropped" / f"{i:05d}.png")
    half = [torch.nn.functional.avg_pool3d(v[:, None], RENDERED // SIZE)[:, 0] for v in (train, test)]
    torch.save({"azimuth": torch.from_numpy(azimuth), "train": half[0], "test": half[1]}, folder / "truth.pt")
    return folder


def true_bins(azimuth: Tensor) -> Tensor:
    return (azimuth / (2 * math.pi) * BINS).round().long() % BINS


def ceiling(folder: Path, form: str, azimuth: Tensor) -> float:
    """Return the exact accuracy of a predictor trained on the true views; computed once."""
    kept = folder / f"ceiling-{form}.json"
    if not kept.exists():
        pictures = up.data.read(path_of(folder, form), size=SIZE)
        panel = up.Panel(up.projections.azimuth_bins(BINS, up.Silhouette(size=SIZE)), pictures, up.Predicted())
        found = supervised_ceiling(up.Volumes(), panel, true_bins(azimuth), 0)
        kept.write_text(json.dumps(found.exact))
    return json.loads(kept.read_text())


def path_of(folder: Path, form: str) -> Path:
    return folder / {"cropped": "cropped", "plain": "plain.npz", "known": "known.npz"}[form]


def name_of(name: str, shapes: int, form: str, minutes: float, seed: int) -> str:
    """Return the name of an arm's run."""
    return f"{name}-{shapes}-{form}-{minutes:g}-{seed}"


def run_arm(called: str, form: str, seed: int, minutes: float, folder: Path, out: Path, device: str) -> dict[str, Any]:
    """Train and score one arm."""
    views = "known" if form == "known" else "predicted"
    recipe = up.recipes.find("shapes")(data=path_of(folder, form), views=views, seed=seed, minutes=minutes)
    run, found = trained(recipe, out / "runs" / called, device)
    found |= shapes_quality(run, folder, fixed=form == "known")
    if form != "known":
        found |= views_quality(run, recipe, folder, form)
    verdict = run.verdict()
    found |= {"verdict": verdict.word, "says": verdict.line}
    up.export.contact_sheet(run.sample(12, seed=1), out / f"{called}.png", size=80)
    return found


def trained(recipe: up.Recipe, place: Path, device: str = "cpu") -> tuple[up.Run, dict[str, Any]]:
    """Train, or go on with what is there; return the run, its steps and its minutes.

    Raises:
        SystemExit: if training was stopped: what it has so far is no result.
    """
    begun = (place / "recipe.json").exists()
    options: dict[str, Any] = {"quiet": True, "device": device}
    run = finished(up.resume(place, **options) if begun else up.train(recipe, place, **options))
    return run, {"steps": run.step, "minutes": minutes_of(run)}


def shapes_quality(run: up.Run, folder: Path, fixed: bool) -> dict[str, float]:
    """Score samples against held-out shapes; `fixed`: they are in the frame of the data."""
    truth = torch.load(folder / "truth.pt")
    train, test = unit_sized(truth["train"]), unit_sized(truth["test"])
    own, hulls = shape_scores(train, test, bins=None), unit_sized(visual_hull(truth["train"]))
    best = shape_scores(hulls, test, bins=None)
    x = run.sample(len(train), seed=1)
    made, bins = unit_sized(at_size(x)), None if fixed else BINS
    scores = shape_scores(made, test, selection=train[:100], bins=bins)
    whole = unit_sized(at_size(run.domain.largest_part(x)))
    exported = shape_scores(whole, test, selection=train[:100], bins=bins)["mmd_iou"].value
    new = test[~are_copied(test, train)]
    of_new = {}
    if len(new):
        against = [shape_scores(made, new, selection=train[:100], bins=bins), shape_scores(train, new, bins=None)]
        of_new = {"mmd_ratio_new": against[0]["mmd_iou"].value / against[1]["mmd_iou"].value}
    return {
        "mmd": scores["mmd_iou"].value,
        "mmd_ratio": scores["mmd_iou"].value / own["mmd_iou"].value,
        "mmd_ratio_exported": exported / own["mmd_iou"].value,
        **of_new,
        "copied": 1 - len(new) / len(test),
        "cov_ratio": scores["cov_iou"].value / own["cov_iou"].value,
        "mmd_of_hulls": best["mmd_iou"].value / own["mmd_iou"].value,
        "cov_of_hulls": best["cov_iou"].value / own["cov_iou"].value,
        "in_one_piece": run.domain.checks(x)["in_one_piece"].value,
    }


def are_copied(shapes: Tensor, training: Tensor) -> Tensor:
    """Return (N,) whether a training shape is nearly the same as a shape, both at one size."""
    a, b = (x.flatten(1) > 0.5 for x in (shapes, training))
    both = a.float() @ b.float().T
    return (both / (a.sum(1)[:, None] + b.sum(1) - both).clamp_min(1)).amax(1) > COPY


def views_quality(run: up.Run, recipe: up.Recipe, folder: Path, form: str) -> dict[str, float]:
    """Score the views that were predicted."""
    azimuth = torch.load(folder / "truth.pt")["azimuth"]
    assigned = run.assignments()[0].estimates()
    assert assigned is not None
    shown = torch.tensor([int(Path(name).stem) for name in recipe.panels[0].collections[0].names])
    exact = view_accuracy(assigned, true_bins(azimuth)[shown], BINS).exact
    return {"views_exact": exact, "views_of_ceiling": exact / ceiling(folder, form, azimuth)}


def at_size(x: Tensor) -> Tensor:
    """Return volumes at the size of the references."""
    return x if x.shape[-1] == SIZE else torch.nn.functional.interpolate(x[:, None], (SIZE,) * 3, mode="area")[:, 0]


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return the results as a Markdown table; MMD / known is over that of known views of the same seed."""
    known = {arm_of(r): r["mmd"] for r in results if r["form"] == "known"}
    names = ("class", "form", "seed", "minutes", "MMD / own (hulls)", "exported", "without copies", "COV / own (hulls)")
    head = f"| {' | '.join(names)} | one piece | views / ceiling | MMD / known | verdict |"
    lines = [head, "|---" * 12 + "|"]
    for r in sorted(results, key=lambda r: (r["class"], FORMS.index(r["form"]), r["seed"], budget_of(r))):
        views = f"{r['views_of_ceiling']:.2f}" if "views_of_ceiling" in r else ""
        base = known.get(arm_of(r))
        ratio = f"{r['mmd'] / base:.2f}" if base and r["form"] != "known" else ""
        lines.append(
            f"| {r['class']} | {r['form']} | {r['seed']} | {budget_of(r):g} "
            f"| {r['mmd_ratio']:.2f} ({r['mmd_of_hulls']:.2f}) "
            f"| {r.get('mmd_ratio_exported', math.nan):.2f} "
            f"| {r.get('mmd_ratio_new', math.nan):.2f} "
            f"| {r['cov_ratio']:.2f} ({r['cov_of_hulls']:.2f}) "
            f"| {r['in_one_piece']:.2f} | {views} | {ratio} | {r.get('verdict', '')} |"
        )
    return "\n".join(lines)


def arm_of(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return what a result has in common with that of known views it is compared with."""
    return tuple(row.get(name) for name in ("class", "seed", "budget", "shapes"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="the folder that holds shapes3d/")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=CLASSES)
    parser.add_argument("--forms", nargs="+", choices=FORMS, default=FORMS)
    parser.add_argument("--seeds", nargs="+", type=int, default=(0, 1))
    parser.add_argument("--shapes", type=int, default=SHAPES, help="training shapes of a class, at most")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="cuda: minutes are those of the clock")
    given = parser.parse_args()
    torch.set_num_threads(1)
    if given.device == "cpu":
        count_cpu_seconds()
    results = Results(given.out / "results.jsonl", ("class", "form", "seed", "budget", "shapes"))
    for seed in given.seeds:
        for name in given.classes:
            for form in given.forms:
                if results.has(name, form, seed, given.minutes, given.shapes):
                    continue
                folder = prepare(name, given.data, given.out, given.shapes)
                called = name_of(name, given.shapes, form, given.minutes, seed)
                found = run_arm(called, form, seed, given.minutes, folder, given.out, given.device)
                about = {"class": name, "form": form, "seed": seed, "budget": given.minutes, "shapes": given.shapes}
                results.add({**about, **found})
    print(table(results.rows))


if __name__ == "__main__":
    main()
