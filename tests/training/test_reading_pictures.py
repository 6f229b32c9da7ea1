"""Pictures that are fitted or compared with are read as those of training were, whatever the operator."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

from unproject._pictures import write_picture
from unproject.assignment import Panel
from unproject.data import Collection, chairs, observe
from unproject.export.materials import to_srgb
from unproject.networks import LowRankGenerator
from unproject.projections import Observation, Projection, Silhouette, Standardised, Uniform, azimuth_bins
from unproject.recipes import find
from unproject.training import Recipe, Run, train
from unproject.training.fitting import state_of, viewing_of
from unproject.training.given_pictures import PictureReader, observed, read_images, references

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


class Signed(Radiograph):
    """Readings far below 0."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return 5 * super().forward(x, azimuth=azimuth) - 4


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


ENCODED: dict[str, Callable[[Tensor], Tensor]] = {
    "flash": lambda y: y,
    "diffuse": lambda y: torch.from_numpy(to_srgb(y.numpy())),
    "roughness": torch.sqrt,
    "normal": lambda n: (n + 1) / 2,
}
"""Observation → how its pictures are stored."""


@pytest.fixture(scope="module")
def of_materials(tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings: dict[str, Any] = {"size": VOXELS, "maps": 8, "renderings": 8, "channels": 16, "batch": 2, "steps": 1}
    recipe = find("wood")(observations=(*ENCODED,), discriminator_channels=4, **settings)
    return train(recipe, tmp_path_factory.mktemp("runs") / "wood", quiet=True)


@pytest.mark.parametrize("name", ENCODED)
def test_pictures_of_materials_are_read_as_those_of_training(of_materials: Run, name: str, tmp_path: Path) -> None:
    """As the projection of the material that they show, whose values are standardised: a fit compares the two."""
    projection = viewing_of(state_of(of_materials.assignments(), name), name).projection
    assert isinstance(projection, Standardised)
    theta = {latent: torch.zeros(2) for latent in projection.latents}
    x = of_materials.sample(2, seed=1)
    measured, expected = (of(x, **theta) for of in (projection.projection, projection))
    for k, picture in enumerate(ENCODED[name](measured).clamp(0, 1)):
        pixels = picture.movedim(0, 2).numpy()
        write_picture(tmp_path / f"{k}.png", pixels if name != "roughness" else pixels[..., 0], "uint16")
    assert (measured - expected).abs().max() > 0.1  # what is read as it was measured would be told
    reader = PictureReader.of(of_materials, name)
    tolerance = 1e-3 / min(projection.deviation)
    for paths in ([tmp_path], [tmp_path / "0.png", tmp_path / "1.png"]):
        torch.testing.assert_close(reader.read(paths).floats(), expected, atol=tolerance, rtol=0)
    given = references(of_materials, tmp_path, name)
    assert isinstance(given, dict)
    torch.testing.assert_close(given[name], measured, atol=1e-3, rtol=0)
    assert f"patch_{name}" in of_materials.evaluate(given, n=4)


def test_readings_of_any_value_are_fitted_as_they_are(volumes: Tensor, tmp_path: Path) -> None:
    view = Observation("signed", Signed(), Uniform("azimuth", 0.0, 0.3))
    pictures = observe(Collection(volumes), [view])
    recipe = Recipe(
        partial(LowRankGenerator, size=VOXELS, channels=8, rank=4),
        [Panel([view], Collection(pictures.floats()))],
        steps=1,
        batch=4,
    )
    run = train(recipe, tmp_path / "run", quiet=True)
    np.savez(tmp_path / "signed.npz", image=pictures.floats()[:, 0].numpy())
    found = observed(run, [tmp_path / "signed.npz"], viewing_of(run.assignments()[0]))
    assert pictures.floats().min() < -1
    torch.testing.assert_close(found.floats(), pictures.floats())
