"""Pictures that are fitted or compared with are read as those of training were, whatever the operator."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

from unproject.assignment import Panel
from unproject.data import Collection, chairs, observe
from unproject.networks import LowRankGenerator
from unproject.projections import Observation, Projection, Silhouette, Uniform, azimuth_bins
from unproject.training import Recipe, Run, train
from unproject.training.fitting import viewing_of
from unproject.training.given_pictures import observed, read_images, references

VOXELS, PIXELS = 16, 32


class Radiograph(Projection):
    """The mean along z of a volume that is turned a little, 32 pixels wide: grey, and dark in the middle of nothing."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        y = 1 - x.mean(3).transpose(1, 2).flip(1)[:, None] * azimuth.cos()[:, None, None, None]
        return F.interpolate(y, (PIXELS, PIXELS))


class Coloured(Radiograph):
    """In three colours."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth) * torch.tensor([1.0, 0.7, 0.3])[:, None, None]


class Shadow(Projection):
    """A silhouette of one's own."""

    silhouettes = True

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return F.interpolate(x.amax(3).transpose(1, 2).flip(1)[:, None], (PIXELS, PIXELS))


OPERATORS = {
    "grey": Radiograph(),
    "colour": Coloured(),
    "shadow": Shadow(),
    "larger silhouette": Silhouette(size=PIXELS),
}


@pytest.fixture(scope="module")
def volumes() -> Tensor:
    return chairs(12, VOXELS, seed=0)


@pytest.fixture(params=OPERATORS)
def of_operator(request: pytest.FixtureRequest, volumes: Tensor, tmp_path: Path) -> tuple[Run, Collection]:
    """A run of two steps, and the pictures that it was trained on."""
    operator, turned = OPERATORS[request.param], Uniform("azimuth", 0.0, 0.3)
    view = azimuth_bins(1, operator)[0] if isinstance(operator, Silhouette) else Observation("view", operator, turned)
    pictures = observe(Collection(volumes), [view])
    generator = partial(LowRankGenerator, size=VOXELS, channels=8, rank=4)
    recipe = Recipe(generator, [Panel([view], Collection(pictures.floats()))], steps=2, batch=4)
    return train(recipe, tmp_path / "run", quiet=True), pictures


@pytest.mark.parametrize("form", ["folder", "npz"])
def test_pictures_are_read_as_those_of_training(of_operator: tuple[Run, Collection], form: str, tmp_path: Path) -> None:
    run, pictures = of_operator
    expected = pictures.floats()
    bytes_ = (expected * 255).round().byte().movedim(1, 3).numpy()
    path = tmp_path / ("pictures" if form == "folder" else "pictures.npz")
    if form == "folder":
        path.mkdir()
        for k, picture in enumerate(bytes_):
            Image.fromarray(picture if picture.shape[2] == 3 else picture[..., 0]).save(path / f"{k:02d}.png")
    else:
        np.savez(path, images=bytes_)
    panel = run.recipe().panels[0]
    cropped = form == "folder" and panel.projection.silhouettes  # as of every folder of silhouettes
    viewing = viewing_of(run.assignments()[0])
    for found in (observed(run, [path], viewing), references(run, path)):
        assert found.shape == panel.shape
        if not cropped:
            torch.testing.assert_close(found.floats(), expected, atol=1 / 255, rtol=0)
    scores = run.evaluate(references(run, path), n=4)
    assert any(name.startswith("mmd") for name in scores)


def test_volumes_are_references_too(of_operator: tuple[Run, Collection], volumes: Tensor, tmp_path: Path) -> None:
    np.savez(tmp_path / "chairs.npz", volume=volumes.numpy())
    run, _ = of_operator
    assert torch.equal(references(run, tmp_path / "chairs.npz").floats(), volumes)
    assert "mmd_iou" in run.evaluate(references(run, tmp_path / "chairs.npz"), n=4)


def test_images_keep_their_colours_if_training_had_them(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", images=np.full((2, 8, 8, 3), (255, 0, 0), np.uint8))
    assert read_images(tmp_path / "a.npz", (3, 8, 8)).floats()[0, :, 0, 0].tolist() == [1, 0, 0]
    assert read_images(tmp_path / "a.npz", (1, 8, 8)).shape == (1, 8, 8)
