"""The image behind a few line integrals: `fit` against methods that learn nothing.

    python benchmarks/fit_images.py --data FOLDER_OF_MNIST --run RESULTS/runs/known-20-0 --n 100 --out OUT
    python benchmarks/fit_images.py --data IMAGES.npz --run RUN --noise 0.02 --out OUT

RUN was trained on line integrals, as those of digits.py were. The first n test images (of an .npz: the last n of its
array x, but none of the first 20, on which others are tuned) are each seen along 3, 5 and 10 lines at known angles,
evenly over half a turn, with noise in units of the largest reading. Columns, with the mean PSNR in dB, of digits also
the share that a classifier takes for the right one (of the images themselves first), and fit's PSNR less that of others
with its standard error:

    fit     the best explanation of `unproject fit`, with its default flags; mean: of all by weight
    sample  as the generator made it (--no-consistent)
    blank   a blank image completed as samples are: what the lines and 0 ≤ x ≤ 1 tell without any generator
    tv      min ½ |A x - y|² + λ TV(x), 0 ≤ x ≤ 1, λ the best of eight on 20 training images for each number of lines
    sart    simultaneous algebraic reconstruction within 0 ≤ x ≤ 1, the best of eight numbers of sweeps on the same
    fbp     filtered back-projection: Ram-Lak filter, adjoint of the strips of `LineIntegral`, clipped to [0, 1]

A line of JSON a number of lines is written to OUT/results.jsonl; OUT/lines-5.png has twelve digits, none chosen.
"""

from __future__ import annotations

import argparse
import gzip
import math
import time
from pathlib import Path

import torch
from digits import SIZE
from results import Results
from torch import Tensor

import unproject as up
from unproject.data import Collection
from unproject.inversion import Search
from unproject.inversion.consistency import Readings
from unproject.metrics.digit_classifier import digit_features

WEIGHTS = tuple(10.0**power for power in torch.linspace(-3.5, 0, 8).tolist())
SWEEPS = (1, 2, 4, 8, 16, 32, 100, 300)
STEPS, TUNED = 1000, 20


def angles_of(count: int) -> Tensor:
    return torch.arange(count) * math.pi / count


def lines_of(x: Tensor, count: int) -> Tensor:
    """Return line integrals (N, A, 1, D) of images (N, 1, H, W)."""
    seen = [up.LineIntegral(SIZE)(x, angle=angle.expand(len(x))) for angle in angles_of(count)]
    return torch.stack(seen, 1)


def adjoint(lines: Tensor, weigh: Tensor) -> Tensor:
    """Return Aᵀ weigh of lines (N, A, 1, D)."""
    x = torch.zeros(len(lines), 1, SIZE, SIZE, requires_grad=True)
    return torch.autograd.grad((lines_of(x, lines.shape[1]) * weigh).sum(), x)[0]


def back_projected(lines: Tensor) -> Tensor:
    """Return filtered back-projections (N, 1, H, W)."""
    n = torch.arange(1 - SIZE, SIZE)
    odd = n % 2 != 0
    ramp = torch.where(odd, -1 / (math.pi * n.float()).square().clamp_min(1e-9), 0.0)
    ramp[SIZE - 1] = 0.25
    flat = lines.flatten(0, 2)[:, None]
    filtered = torch.nn.functional.conv1d(flat, ramp[None, None] * SIZE, padding=SIZE - 1).view_as(lines)
    each = adjoint(lines, torch.ones_like(lines)).clamp_min(1e-6) / lines.shape[1]
    return (math.pi / lines.shape[1] * adjoint(lines, filtered) / each).clamp(0, 1)


def smoothest(lines: Tensor, weight: float) -> Tensor:
    """Return images (N, 1, H, W) of least total variation, by Adam on pixels with a falling rate."""
    x = torch.full((len(lines), 1, SIZE, SIZE), 0.1, requires_grad=True)
    adam = torch.optim.Adam([x], lr=0.03)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, STEPS)
    for _ in range(STEPS):
        inside = x.clamp(0, 1) + 0.01 * (x - x.clamp(0, 1))  # pixels that left the range come back
        misfit = 0.5 * (lines_of(inside, lines.shape[1]) - lines).square().sum() * SIZE
        down, across = inside.diff(dim=2)[..., :-1], inside.diff(dim=3)[..., :-1, :]
        total = (down.square() + across.square() + 1e-8).sqrt().sum() / SIZE
        adam.zero_grad()
        (misfit + weight * total).backward()
        adam.step()
        falling.step()
    return x.detach().clamp(0, 1)


def sart(lines: Tensor, sweeps: int) -> Tensor:
    """Return images (N, 1, H, W) by simultaneous algebraic reconstruction, an angle at a time."""
    x = torch.zeros(len(lines), 1, SIZE, SIZE)
    ones = torch.ones(1, 1, SIZE, SIZE)
    views = [(angle, lines[:, m]) for m, angle in enumerate(angles_of(lines.shape[1]))]
    for _ in range(sweeps):
        for angle, y in views:
            x.requires_grad_(True)
            seen = up.LineIntegral(SIZE)(x, angle=angle.expand(len(x)))
            length = up.LineIntegral(SIZE)(ones, angle=angle[None]).clamp_min(1e-6)
            (back,) = torch.autograd.grad(seen, x, (y - seen) / length, retain_graph=True)
            (each,) = torch.autograd.grad(seen, x, torch.ones_like(seen))
            x = (x.detach() + back / each.clamp_min(1e-6)).clamp(0, 1)
    return x.detach()


def blank(lines: Tensor) -> Tensor:
    """Return blank images completed to agree with lines, (N, 1, H, W)."""
    angles = angles_of(lines.shape[1])
    shape = torch.Size((1, SIZE, SIZE))
    readings = Readings.of(lambda x, which: up.LineIntegral(SIZE)(x, angle=angles[which]), len(angles), shape)
    nothing = torch.zeros(1, SIZE * SIZE, dtype=torch.float64)
    found = [readings.completed(nothing, y, (0.0, 1.0)) for y in lines.flatten(1).double()]
    return torch.cat(found).view(-1, *shape).float()


def noisy(lines: Tensor, share: float) -> Tensor:
    """Return lines with noise, its deviation a share of the largest."""
    rng = torch.Generator().manual_seed(0)
    return lines + share * lines.amax() * torch.randn(lines.shape, generator=rng)


def psnr(found: Tensor, true: Tensor) -> float:
    """Return the mean of the images' PSNR, dB."""
    return (-10 * (found - true).square().flatten(1).mean(1).clamp_min(1e-8).log10()).mean().item()


def scores(name: str, found: Tensor, true: Tensor, labels: Tensor | None) -> dict[str, float]:
    if labels is None:
        return {f"psnr_{name}": psnr(found, true)}
    right = (digit_features(found)[1] == labels).float().mean().item()
    return {f"psnr_{name}": psnr(found, true), f"accuracy_{name}": right}


def ahead(found: Tensor, other: Tensor, true: Tensor) -> dict[str, float]:
    """Return by how many dB images are better than others on average, and the standard error of it."""
    by = torch.tensor([psnr(a, y) - psnr(b, y) for a, b, y in zip(found, other, true, strict=True)])
    return {"ahead": by.mean().item(), "standard_error": by.std().item() / len(by) ** 0.5}


def compared(run: up.Run, count: int, given: argparse.Namespace) -> dict[str, object]:
    """Return the scores for this number of lines."""
    training, images = images_of(given.data, given.n)
    labels = labels_of(given.data, given.n)
    lines, seen = noisy(lines_of(images, count), given.noise), noisy(lines_of(training, count), given.noise)
    weight = max(WEIGHTS, key=lambda w: psnr(smoothest(seen, w), training))
    sweeps = max(SWEEPS, key=lambda n: psnr(sart(seen, n), training))
    found: dict[str, Tensor] = {}
    for name, consistent in (("sample", False), ("fit", True)):
        fitter = run.fitter(search=Search(starts=8, tune=30, consistent=consistent))
        _ = fitter.candidates.variance
        begin = time.process_time()
        fits = [fitter.fit(y, {"angle": angles_of(count)}) for y in lines]
        seconds = (time.process_time() - begin) / len(fits)
        found |= {name: torch.stack([fit.x[0] for fit in fits]), "mean": torch.stack([fit.mean for fit in fits])}
    found |= {"blank": blank(lines), "tv": smoothest(lines, weight), "sart": sart(lines, sweeps)}
    found["fbp"] = back_projected(lines)
    shown = torch.cat([images[:12], *(x[:12] for x in found.values())])
    up.export.silhouette_sheet(shown, columns=12, scale=2).save(given.out / f"lines-{count}-{given.noise:g}.png")
    row: dict[str, object] = {"n": len(images), "tv_weight": weight, "sweeps": sweeps, "cpu_seconds": seconds}
    row |= {f"over_{name}": ahead(found["fit"], found[name], images) for name in ("sample", "blank", "tv", "sart")}
    for name, x in {"truth": images, **found}.items():
        row |= scores(name, x, images, labels)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with the idx files of MNIST, or an .npz")
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--n", type=int, default=100)
    parser.add_argument("--lines", type=int, nargs="+", default=(3, 5, 10))
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    torch.set_num_threads(1)
    results = Results(given.out / "results.jsonl", ("run", "lines", "noise"))
    for count in given.lines:
        if not results.has(str(given.run), count, given.noise):
            found = compared(up.load(given.run), count, given)
            results.add({"run": str(given.run), "lines": count, "noise": given.noise, **found})


def images_of(data: Path, n: int) -> tuple[Tensor, Tensor]:
    """Return 20 training images and n test images."""
    if data.suffix == ".npz":
        images = Collection.images(data, SIZE).floats()
        if len(images) <= TUNED:
            raise SystemExit(f"{data}: holds {len(images)} images, and the first {TUNED} are for tuning; give more")
        return images[:TUNED], images[TUNED:][-n:]
    training, images = (Collection.images(data / f"{part}-images-idx3-ubyte.gz", SIZE) for part in ("train", "t10k"))
    return training.floats()[:TUNED], images.floats()[:n]


def labels_of(data: Path, n: int) -> Tensor | None:
    """Return the first n labels of the test images of digits."""
    if data.suffix == ".npz":
        return None
    raw = gzip.decompress((data / "t10k-labels-idx1-ubyte.gz").read_bytes())
    return torch.tensor(list(raw[8 : 8 + n]))


if __name__ == "__main__":
    main()
