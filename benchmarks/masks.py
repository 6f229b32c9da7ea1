"""Masks of real objects: how collections become folders of PNGs, and how near silhouettes of samples come to them.

There is no 3-D truth of real objects. With r pictures that discriminators never saw, g silhouettes of samples in views
as frequent as those predicted, and t training pictures, as many as g:

    distance = mean_r min_g (1 - IoU)        distance_ratio = distance / mean_r min_t (1 - IoU)

A ratio of 1: silhouettes of samples are as near to new pictures as training pictures are.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from unproject.data import Collection
from unproject.data.sampling import spread_rows
from unproject.metrics import silhouette_scores
from unproject.training import Recipe, Run
from unproject.training.evaluation import projected

MOST = 512
"""Silhouettes of samples, and training pictures, at most."""
SILHOUETTES = "iou_silhouette"


@dataclass(frozen=True)
class Source:
    """An array of masks in silhouettes/: all of them, or those of a class."""

    file: str
    label: str = ""

    def masks(self, data: Path) -> np.ndarray:
        """Return (N, H, W), true where the object is."""
        stored = np.load(data / "silhouettes" / self.file)
        if not self.label:
            return stored["sil"]
        return stored["sil"][stored["label"].ravel() == [*stored["classnames"]].index(self.label)]


SOURCES = {
    "birds": Source("bird_cub_aves_64.npz"),
    "chairs": Source("chair_ikea_64.npz"),
    "seats": Source("seats_ikea_all154_64.npz"),
    "airplanes": Source("caltech101_28.npz", "Airplanes Side 2"),
    "motorbikes": Source("caltech101_28.npz", "Motorbikes 16"),
    "car_side": Source("caltech101_28.npz", "car side"),
}


def write_folder(masks: np.ndarray, folder: Path) -> Path:
    """Write masks (N, H, W) as PNGs, white on black, unless they are there; the folder is there whole or not at all."""
    if not folder.exists():
        begun = folder.with_name(f".{folder.name}.tmp")
        shutil.rmtree(begun, ignore_errors=True)
        begun.mkdir(parents=True)
        for i, mask in enumerate(masks):
            Image.fromarray(mask.astype(np.uint8) * 255).save(begun / f"{i:05d}.png")
        begun.rename(folder)
    return folder


def some_of(collection: Collection, most: int) -> Tensor:
    """Return at most so many of the pictures, evenly in their order."""
    return collection.batch(spread_rows(len(collection), most))


@torch.no_grad()
def silhouettes_quality(run: Run, recipe: Recipe, real: Tensor, seed: int = 1) -> dict[str, float]:
    """Score a run against pictures (M, 1, H, W) that were held out, framed as those of its panel are."""
    (state,) = run.assignments()
    others = some_of(state.panel.collections[0], MOST)
    x = run.sample(len(others), seed)
    found, own = (silhouette_scores(y, real, seed=seed) for y in (projected(state, x, seed), others))
    mmd, cov = (f"{name}_{SILHOUETTES}" for name in ("mmd", "cov"))
    return {
        "distance": found[mmd].value,
        "distance_ratio": found[mmd].value / max(own[mmd].value, 1e-6),
        "cov_ratio": found[cov].value / own[cov].value,
        "in_one_piece": run.domain.checks(x)["in_one_piece"].value,
        "held_out": len(real),
    }
