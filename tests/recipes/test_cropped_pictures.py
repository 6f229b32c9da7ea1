"""Pictures that were cropped one by one are learned as such; others, and what is rendered here, are not."""

from __future__ import annotations

import math
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._types import UserError
from unproject.adversarial.regularisers import Centred, Regularisers
from unproject.assignment import JointlyPredicted
from unproject.data import ReadOptions, chairs, pack
from unproject.domains import Volumes
from unproject.ops import bounding_box, level_of_thin_parts
from unproject.projections.cropped import Cropped
from unproject.projections.silhouette import Silhouette
from unproject.recipes.shapes import shapes
from unproject.training import Recipe, train

SMALL: dict[str, Any] = {"size": 16, "bins": 4, "channels": 8, "rank": 2}
SILHOUETTE = Silhouette(size=16, rule="absorption", density=2.0)


def only_projection(recipe: Recipe) -> Any:
    (panel,) = recipe.panels
    return panel.projection


def only_panel(recipe: Recipe) -> Any:
    (panel,) = recipe.panels
    return panel


def as_arrays(masks: Path) -> Path:
    """The same pictures as arrays, which are taken as they are."""
    pictures = [np.asarray(Image.open(path)) for path in sorted(masks.glob("*.png"))]
    np.savez(masks / "masks.npz", images=np.stack(pictures))
    return masks / "masks.npz"


@pytest.mark.parametrize("views", ["predicted", "known", "single", "learned"])
def test_a_folder_of_pictures_is_cropped(views: Any, known_masks: Path) -> None:
    made = shapes(data=known_masks, views=views, **SMALL)
    look = only_projection(made)
    assert isinstance(look, Cropped) and look.silhouette == SILHOUETTE and 0.2 <= look.height <= 0.85
    assert made.domain == Volumes(sized=False)
    (panel,) = made.panels
    box = bounding_box(torch.cat([part.floats() for part in panel.collections]))
    assert (box.height / 16 - look.height).abs().quantile(0.8) < 0.1


def test_thin_parts_of_cut_outs_are_learned_in_one_piece(tmp_path: Path) -> None:
    """Legs of two thirds of a voxel; and of two, which need no help."""
    for name, width in (("thin", 8), ("thick", 24)):
        (tmp_path / name).mkdir()
        for k in range(12):
            picture = np.zeros((192, 192), np.uint8)
            picture[20:90, 30:160] = 255
            for left in (36 + k, 130 - k):
                picture[90:180, left : left + width] = 255
            Image.fromarray(picture).save(tmp_path / name / f"{k}.png")
    thin, thick = (only_panel(shapes(data=tmp_path / name, **SMALL)) for name in ("thin", "thick"))
    assert thin.projection.level < 0.5 == thick.projection.level
    assert level_of_thin_parts(thin.collections[0].floats()) == 0.5


def stools(folder: Path, leg: int) -> Path:
    """Twelve stools of 400 by 220 to 286 pixels, whose legs are `leg` pixels wide."""
    folder.mkdir()
    for k in range(12):
        picture, width = np.zeros((512, 512), np.uint8), 220 + 6 * k
        picture[40:80, 60 : 60 + width] = 255
        for left in (70, 50 + width - leg):
            picture[40:440, left : left + leg] = 255
        Image.fromarray(picture).save(folder / f"{k:02d}.png")
    return folder


@pytest.mark.parametrize("leg", [4, 12])
def test_thin_legs_count_as_the_object_in_a_folder_and_in_its_pack(leg: int, tmp_path: Path) -> None:
    """Legs of 0.15 and 0.45 pixels: without them the stools would be learned as plates, a fifth of the frame wide."""
    folder = stools(tmp_path / "stools", leg)
    pack(folder, tmp_path / "stools.npz", ReadOptions(32))
    for data in (folder, tmp_path / "stools.npz"):
        made = shapes(data=data, **SMALL)
        assert only_projection(made).height == 0.85
        shown = only_panel(made).collections[0].floats()
        assert (shown[:, 0, 8:12].amax((1, 2)) >= 0.1).all() and shown[:, 0, 10].amax(1).max() < 1


def test_what_is_too_long_for_the_frame_is_said(tmp_path: Path) -> None:
    for k in range(5):
        picture = np.zeros((300, 300), np.uint8)
        picture[140:160, 20 : 180 + 20 * k] = 255
        Image.fromarray(picture).save(tmp_path / f"{k}.png")
    with pytest.warns(UserWarning, match="many pictures are over 4.5 times as wide as high: they are cut at both"):
        shapes(data=tmp_path, **SMALL)


def test_pictures_that_are_skipped_are_said(masks: Path) -> None:
    (masks / "broken.png").write_bytes(b"no picture")
    with pytest.warns(UserWarning, match="1 of 6 skipped, the first: broken.png: unreadable"):
        shapes(data=masks, **SMALL)


@pytest.mark.parametrize("bands, hull", [(None, 2.0), (1, 2.0), (3, False)])
def test_hulls_are_sampled_of_level_cameras_alone(bands: int | None, hull: float | bool, known_masks: Path) -> None:
    generator = shapes(data=known_masks, views="known", bands=bands, **SMALL).generator
    assert isinstance(generator, partial) and generator.keywords["hull"] == hull


def test_arrays_of_pictures_of_many_sizes_are_not(masks: Path) -> None:
    made = shapes(data=as_arrays(masks), **SMALL)
    assert isinstance(only_projection(made), Silhouette)
    assert made.domain == Volumes(sized=True)


@pytest.mark.parametrize("views", ["predicted", "known", "direct"])
def test_rendered_volumes_are_not_even_if_all_are_equal(views: Any, tmp_path: Path) -> None:
    x, y, z = np.mgrid[:16, :16, :16] - 7.5
    cylinders = np.stack([(np.hypot(x, z) < 5) & (abs(y) < 6)] * 6).astype(np.float32)  # alike from all sides
    np.savez(tmp_path / "cylinders.npz", volume=cylinders)
    made = shapes(data=tmp_path / "cylinders.npz", views=views, **SMALL)
    assert not isinstance(only_projection(made), Cropped) and made.domain == Volumes()


@pytest.mark.parametrize("mirror", [True, False])
def test_views_are_predicted_jointly_with_the_weight_that_is_asked_for(mirror: bool, masks: Path) -> None:
    (panel,) = shapes(data=masks, information=0.7, mirror=mirror, **SMALL).panels
    assert isinstance(panel.assignment, JointlyPredicted) and panel.assignment.weight == 0.7
    assert panel.assignment.fit.mirrored == ((0, 3, 2, 1) if mirror else None)


def learned(recipe: Recipe) -> list[str]:
    (panel,) = recipe.panels
    return [latent.name for latent in panel.learned]


def test_what_is_learned_of_cameras(known_masks: Path, volumes: Path) -> None:
    """Of renderings as they are, elevation; of cropped pictures, which count as level, and of known cameras nothing."""
    arrays = as_arrays(known_masks)
    for views in ("predicted", "single", "learned"):
        assert learned(shapes(data=known_masks, views=views, **SMALL)) == []
        assert learned(shapes(data=arrays, views=views, **SMALL)) == ["elevation"]
        assert learned(shapes(data=volumes, views=views, **SMALL)) == []
    assert learned(shapes(data=known_masks, views="known", **SMALL)) == []
    for settings in ({"bands": 1}, {"bands": 3}):
        assert learned(shapes(data=arrays, **settings, **SMALL)) == []


@pytest.mark.parametrize(("elevation", "found"), [(0.0, []), (0.14, ["elevation"]), (0.45, ["elevation"])])
def test_no_cameras_are_learned_of_outlines_that_are_level(elevation: float, found: list[str], tmp_path: Path) -> None:
    x = chairs(60, 64, seed=5)
    azimuth = torch.rand(60, generator=torch.Generator().manual_seed(0)) * 2 * math.pi
    seen = Silhouette(size=64)(x, azimuth=azimuth, elevation=torch.full((60,), elevation))
    np.savez(tmp_path / "chairs.npz", images=(seen[:, 0] > 0.5).numpy())
    assert learned(shapes(data=tmp_path / "chairs.npz", **SMALL | {"size": 32})) == found
    assert learned(shapes(data=tmp_path / "chairs.npz", **SMALL | {"size": 64})) == found


def test_shapes_are_kept_in_the_middle_if_pictures_were_cropped(masks: Path) -> None:
    made = [shapes(data=data, **SMALL).regulariser for data in (masks, as_arrays(masks))]
    assert [Centred(axes="xz") in found.terms for found in made if isinstance(found, Regularisers)] == [True, False]
    tilted = shapes(data=masks, **SMALL | {"bands": 3}).regulariser
    assert isinstance(tilted, Regularisers) and Centred(axes="xyz") in tilted.terms


@pytest.mark.parametrize("views", ["predicted", "known", "single", "learned"])
def test_every_arm_trains_on_cropped_pictures(views: Any, known_masks: Path, tmp_path: Path) -> None:
    made = shapes(data=known_masks, views=views, steps=2, **SMALL).replace(batch=8, views_per_sample=2)
    run = train(made, tmp_path / "run", quiet=True)
    assert run.step == 2 and run.generator.sample(2).shape == (2, 16, 16, 16)


def test_direct_training_trains(volumes: Path, tmp_path: Path) -> None:
    made = shapes(data=volumes, views="direct", steps=2, **SMALL).replace(batch=4, views_per_sample=1)
    assert train(made, tmp_path / "run", quiet=True).step == 2


def test_cropped_objects_are_scored_at_one_size() -> None:
    small, large = torch.zeros(2, 1, 16, 16, 16)
    small[:, 2:6, 4:8, 2:8], large[:, 4:12, 3:11, 2:14] = 1, 1
    pair = [torch.cat([x, x.flip(1).roll(1, 2)]) for x in (small, large)]
    free, sized = (Volumes(sized=sized).scores(*pair) for sized in (False, True))
    assert set(free) == set(sized)
    name = next(name for name in free if "coverage" not in name and "iou" in free[name].protocol)
    assert free[name].value != sized[name].value
    assert all("all at one size" in score.protocol for score in free.values())
    assert not any("all at one size" in score.protocol for score in sized.values())


def test_pictures_of_nothing_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "black.npz", masks=np.zeros((6, 16, 16), np.uint8))
    with pytest.raises(UserError, match="black.npz: masks: no picture has anything above 0.5"):
        shapes(data=tmp_path / "black.npz", **SMALL)


def test_a_folder_that_is_named_as_materials_are_is_warned_of(masks: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shapes(data=masks, **SMALL)
    for number, name in enumerate(("Color", "Roughness", "NormalGL")):
        sorted(masks.glob("*.png"))[number].rename(masks / f"Wood_{name}.png")
    with pytest.warns(UserWarning, match="is named as materials are.*data inspect.*train materials"):
        shapes(data=masks, **SMALL)
