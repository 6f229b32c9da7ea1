"""What single silhouettes from level cameras can tell: that cameras are level, the view, and the shape.

    python benchmarks/level_views.py --data SHARED

SHARED as in any_class.py. Prints for each of its nine classes

    level       `ops.level_share` of 240 silhouettes, 64 pixels a side, of forty training shapes at uniform azimuths,
                at several elevations, mean and deviation in degrees: as rendered, and cropped to 32 pixels
    views       log 16 less the cross entropy, nats, of 16 views of pictures of other shapes, of a predictor that is
                given the true views: the best of several lengths of training, since long ones learn by heart
    hulls       MMD and COV of the visual hulls of the training shapes, over those of the shapes themselves
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import torch
from any_class import BINS, CLASSES, RENDERED, SIZE, prepare, true_bins, volumes_of
from torch import Tensor

import unproject as up
from unproject.assignment.predictor import PredictorFit
from unproject.data.sampling import spread_rows
from unproject.metrics import shape_scores
from unproject.ops import level_share, unit_sized, visual_hull

ELEVATIONS = ((0, 0), (2, 0), (4, 2), (8, 5), (15, 5), (25, 8))
SHAPES, SILHOUETTES = 40, 240
LENGTHS = (30, 60, 120, 240)
"""Steps of a predictor."""


@dataclass(frozen=True)
class Tilted(up.Prior):
    """Uniform azimuths; normal elevations, radians."""

    elevation: float
    deviation: float
    names = ("azimuth", "elevation")

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        azimuth = 2 * math.pi * torch.rand(n, generator=rng)
        return {"azimuth": azimuth, "elevation": self.elevation + self.deviation * torch.randn(n, generator=rng)}

    def contains(self, latents: dict[str, Tensor]) -> Tensor:
        return torch.ones_like(latents["azimuth"], dtype=torch.bool)


def silhouettes(volumes: Tensor, elevation: float, deviation: float) -> Tensor:
    """Return binary silhouettes of shapes, elevations in degrees."""
    volumes = volumes[spread_rows(len(volumes), SHAPES)]
    prior = Tilted(math.radians(elevation), math.radians(deviation))
    each = math.ceil(SILHOUETTES / len(volumes))
    camera = up.Observation("tilted", up.Silhouette(size=RENDERED), prior)
    seen = up.data.observe(up.Collection(volumes), [camera], each, seed=5, binary=True, chunk=16)
    return seen.batch(spread_rows(len(seen), SILHOUETTES))


def cropped(pictures: Tensor) -> Tensor:
    """Return pictures as a folder of them is read for training at 32³."""
    found = []
    for one in pictures:
        with suppress(up.data.UnusablePicture):  # empty, or a box that fills its picture
            found.append(up.data.frame(one[0].numpy(), SIZE).image)
    return torch.stack(found)


def information_of_views(folder: Path) -> float:
    """Return the held-out information of true views in nats, at most; halves of a collection share no shape."""
    pictures = up.data.read(folder / "cropped", size=SIZE)
    shown = torch.tensor([int(Path(name).stem) for name in pictures.names])
    true = true_bins(torch.load(folder / "truth.pt")["azimuth"])[shown]
    half = len(true) // 2
    found = []
    for steps in LENGTHS:
        fit = PredictorFit(steps=steps)
        torch.manual_seed(0)
        predictor = fit.network((1, SIZE, SIZE), BINS)
        fit.fitted(predictor, pictures.batch(torch.arange(half)), true[:half], 0)
        p = fit.probabilities(predictor, pictures.batch(torch.arange(half, len(true))).split(512))
        found.append(math.log(BINS) + p.gather(1, true[half:, None]).clamp_min(1e-6).log().mean().item())
    return max(found)


def hulls(folder: Path) -> tuple[float, float]:
    """Return MMD and COV of visual hulls over those of the shapes that they are the hulls of."""
    truth = torch.load(folder / "truth.pt")
    test = unit_sized(truth["test"])
    own, hull = (shape_scores(unit_sized(x), test, bins=None) for x in (truth["train"], visual_hull(truth["train"])))
    return hull["mmd_iou"].value / own["mmd_iou"].value, hull["cov_iou"].value / own["cov_iou"].value


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="the folder that holds shapes3d/")
    parser.add_argument("--out", type=Path, default=Path("runs/level_views"), help="keeps rendered silhouettes")
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=CLASSES)
    given = parser.parse_args(argv)
    torch.set_num_threads(1)
    degrees = [f"{mean}° ± {deviation}°" if deviation else f"{mean}°" for mean, deviation in ELEVATIONS]
    print(f"| class | {' | '.join(degrees)} | views | hulls, MMD | COV |\n" + "|---" * (len(degrees) + 4) + "|")
    for name in given.classes:
        volumes, _ = volumes_of(name, given.data)
        seen = [silhouettes(volumes, *elevation) for elevation in ELEVATIONS]
        shares = [f"{level_share(s):.2f}, {level_share(cropped(s)):.2f}" for s in seen]
        folder = prepare(name, given.data, given.out)
        mmd, cov = hulls(folder)
        print(
            f"| {name} | {' | '.join(shares)} | {information_of_views(folder):.2f} | {mmd:.2f} | {cov:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
