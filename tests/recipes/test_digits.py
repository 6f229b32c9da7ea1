"""The digits recipes: line integrals of images paired with directions, four arms by one flag."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
import torch

from unproject._types import UserError
from unproject.adversarial.augmentation import Shift
from unproject.adversarial.penalties import R1R2
from unproject.assignment import JointlyPredicted, Known, LearnedPrior, Panel, Predicted, Unassigned
from unproject.data import digits as embedded
from unproject.data.readers.images import fitted
from unproject.projections.base import Identity
from unproject.recipes import find
from unproject.recipes.digits import digits, digits_paper
from unproject.recipes.pairing import Views
from unproject.training import Recipe, Tries


def only_panel(recipe: Recipe) -> Panel:
    (panel,) = recipe.panels
    return panel


@pytest.mark.parametrize(
    "recipe, views, observations, heads, assignment",
    [
        (digits, "known", 10, 10, Known),
        (digits, "predicted", 20, 20, Predicted),  # anywhere around
        (digits, "learned", 20, 1, LearnedPrior),
        (digits, "single", 10, 1, Unassigned),
        (digits_paper, "known", 10, 10, Known),
        (digits_paper, "predicted", 10, 10, Predicted),
        (digits_paper, "learned", 10, 1, LearnedPrior),
        (digits_paper, "single", 10, 1, Unassigned),
    ],
)
def test_the_arms(recipe, views: Views, observations: int, heads: int, assignment: type) -> None:  # type: ignore[no-untyped-def]
    panel = only_panel(recipe(views=views, size=16, steps=1))
    assert len(panel.observations) == observations and isinstance(panel.assignment, assignment)
    assert panel.assignment.heads(panel) == heads
    assert panel.shape == (1, 16) and len(panel) == 1500
    assert len(panel.collections) == (10 if views == "known" else 1)


def test_direct_training_sees_the_images() -> None:
    panel = only_panel(digits(views="direct", size=16, steps=1))
    assert isinstance(panel.projection, Identity) and torch.equal(panel.batch(torch.arange(1500)), embedded(16))


def test_known_lines_are_the_line_integrals_of_the_images_in_their_direction() -> None:
    """A line integral keeps the whole mass of an image that lies within the detectors, whatever its direction."""
    panel = only_panel(digits(size=16, steps=1))
    for observation, collection in zip(panel.observations, panel.collections, strict=True):
        assert observation.prior.contains(collection.latents).all()
    rows = [int(name.split("#")[0]) for collection in panel.collections for name in collection.names]
    seen = torch.cat([collection.items.mean(2)[:, 0] for collection in panel.collections])
    torch.testing.assert_close(seen, embedded(16)[rows].mean((1, 2, 3)), rtol=1e-2, atol=1e-3)
    assert sorted(rows) == list(range(1500))


def test_several_views_of_each_image() -> None:
    assert len(only_panel(digits(size=16, views_per_image=3, steps=1))) == 4500


def test_an_idx_file_gets_a_margin(tmp_path: Path) -> None:
    images = np.random.default_rng(0).integers(0, 256, (5, 28, 28), dtype=np.uint8)
    header = struct.pack(">BBBBIII", 0, 0, 8, 3, *images.shape)
    (tmp_path / "some-idx3-ubyte.gz").write_bytes(gzip.compress(header + images.tobytes()))
    (collection,) = only_panel(digits(data=tmp_path / "some-idx3-ubyte.gz", views="direct", steps=1)).collections
    assert collection.items.shape == (5, 1, 32, 32)
    torch.testing.assert_close(collection.floats()[:, 0, 2:30, 2:30], torch.from_numpy(images / 255.0).float())
    assert not collection.items[:, 0, :2].any() and not collection.items[:, 0, :, 30:].any()


def test_larger_pictures_are_resampled(tmp_path: Path) -> None:
    np.savez(tmp_path / "large.npz", images=np.ones((3, 64, 64), np.float32))
    (collection,) = only_panel(digits(data=tmp_path / "large.npz", views="direct", size=32, steps=1)).collections
    torch.testing.assert_close(collection.items, torch.ones(3, 1, 32, 32))


def test_an_odd_margin() -> None:
    assert torch.equal(fitted(torch.ones(1, 1, 2, 3), 4)[0, 0].nonzero()[0], torch.tensor([1, 0]))


def test_pictures_that_fit_in_several_times_are_enlarged() -> None:
    """MNIST's 28 pixels are 56 of 64, and 28 of 32."""
    picture = torch.zeros(1, 1, 28, 28, dtype=torch.uint8)
    picture[..., :14] = 200
    large = fitted(picture, 64)[0, 0]
    assert large.dtype == torch.uint8 and not large[:4].any() and not large[:, :4].any()
    assert (large[4:60, 4:30] == 200).all() and not large[:, 34:].any()
    assert torch.equal(fitted(picture, 32)[..., 2:30, 2:30], picture)


def test_volumes_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "volumes.npz", volume=np.triu(np.ones((3, 16, 16, 16), np.float32)))
    with pytest.raises(UserError, match="holds volumes; images are learned from"):
        digits(data=tmp_path / "volumes.npz", steps=1)


def test_they_are_found_by_name() -> None:
    assert find("digits") is digits and find("digits-paper") is digits_paper


def test_measured_lines_are_used_as_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines, angle = rng.random((40, 48), np.float32), rng.integers(10, size=40) * np.pi / 10 + 0.01
    np.savez(tmp_path / "scans.npz", lines=lines, angle=angle)
    panel = only_panel(digits(data=tmp_path / "scans.npz", steps=1))
    for observation, collection in zip(panel.observations, panel.collections, strict=True):
        rows = [int(name) for name in collection.names]
        assert observation.prior.contains(collection.latents).all() and collection.items.shape[1:] == (1, 48)
        assert np.allclose(collection.items[:, 0].numpy(), lines[rows])
    assert len(panel) == 40
    panel = only_panel(digits(data=tmp_path / "scans.npz", views="predicted", steps=1))
    (collection,) = panel.collections
    assert len(panel.observations) == 20 and np.allclose(collection.items[:, 0].numpy(), lines)
    assert panel.projection(torch.rand(2, 1, 32, 32), angle=torch.zeros(2)).shape == (2, 1, 48)
    with pytest.raises(UserError, match="direct training needs images"):
        digits(data=tmp_path / "scans.npz", views="direct", steps=1)


def test_lines_without_directions_are_for_predicted_ones(tmp_path: Path) -> None:
    np.savez(tmp_path / "scans.npz", lines=np.random.default_rng(0).random((40, 1, 16), np.float32))
    panel = only_panel(digits(data=tmp_path / "scans.npz", views="predicted", steps=1))
    assert len(panel) == 40 and panel.shape == (1, 16)
    with pytest.raises(UserError, match="known views are asked for .* `angle`"):
        digits(data=tmp_path / "scans.npz", steps=1)
    np.savez(tmp_path / "scans.npz", lines=np.zeros((4, 2, 16), np.float32))
    with pytest.raises(UserError, match=r"line integrals are \(N, D\)"):
        digits(data=tmp_path / "scans.npz", steps=1)


def measured(folder: Path, unit: float, **arrays: np.ndarray) -> Path:
    rng = np.random.default_rng(1)
    np.savez(folder / "measured.npz", lines=rng.random((60, 32)) * unit, angle=np.linspace(-3, 9, 60), **arrays)
    return folder / "measured.npz"


@pytest.mark.parametrize("recipe", [digits, digits_paper])
def test_measured_lines_have_directions_without_gaps(recipe, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """At any angle, of several turns; in any unit. Windows are for those who ask for them."""
    path = measured(tmp_path, 40.0)
    panel = only_panel(recipe(data=path, steps=1))
    assert len(panel) == 60
    for observation, collection in zip(panel.observations, panel.collections, strict=True):
        assert observation.prior.contains(collection.latents).all()
        assert collection.items.max() < 0.55
    for views in ("predicted", "learned", "single"):
        observations = only_panel(recipe(data=path, views=views, steps=1)).observations
        angles = torch.linspace(-0.15, 2.98, 50)
        assert torch.stack([o.prior.contains({"angle": angles}) for o in observations]).any(0).all()
    with pytest.raises(UserError, match="outside every bin; leave them out, or widen --spread: 90 / bins degrees"):
        recipe(data=path, spread=2.5, steps=1)


def test_the_axis_of_rotation_is_that_of_measured_lines(tmp_path: Path) -> None:
    panel = only_panel(digits(data=measured(tmp_path, 1.0), center=16, steps=1))
    assert panel.shape == (1, 33)
    assert panel.projection(torch.rand(2, 1, 32, 32), angle=torch.zeros(2)).shape == (2, 1, 33)
    with pytest.raises(UserError, match="give a detector of those there are, 0 to 31"):
        digits(data=measured(tmp_path, 1.0), center=40, steps=1)
    with pytest.raises(UserError, match="center=16 is of measured lines"):
        digits(center=16, steps=1)


def test_anchors_are_a_panel_of_known_directions_in_the_same_unit(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    np.savez(tmp_path / "some.npz", lines=rng.random((200, 32)) * 40)
    anchors = measured(tmp_path, 40.0)
    recipe = digits(data=tmp_path / "some.npz", views="predicted", anchors=anchors, center=16, steps=1)
    unlabelled, known = recipe.panels
    assert isinstance(known.assignment, Known) and isinstance(unlabelled.assignment, Predicted)
    assert len(known) == 60 and len(unlabelled) == 200 and known.shape == unlabelled.shape == (1, 33)
    largest = [max(part.items.max().item() for part in panel.collections) for panel in recipe.panels]
    assert largest[0] == pytest.approx(largest[1], rel=0.02) and known.penalty_scale > 1
    assert known.weight < unlabelled.weight / 5  # few lines must not pull all images to what they are of
    for observation, collection in zip(known.observations, known.collections, strict=True):
        assert observation.prior.contains(collection.latents).all()
    images, of_images = digits(views="predicted", size=32, anchors=measured(tmp_path, 0.5), spread=9.0, steps=1).panels
    assert isinstance(of_images.assignment, Known) and images.shape == of_images.shape


def test_anchors_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    anchors = measured(tmp_path, 0.5)
    with pytest.raises(UserError, match="has lines of 32 detectors, not 16"):
        digits(views="predicted", size=16, anchors=anchors, steps=1)
    with pytest.raises(UserError, match="outside every bin"):
        digits(views="predicted", anchors=anchors, steps=1)
    for views in ("known", "direct"):
        with pytest.raises(UserError, match=f"leave them out with {views} views"):
            digits(views=views, anchors=anchors, steps=1)
    np.savez(tmp_path / "none.npz", lines=np.ones((4, 32), np.float32))
    with pytest.raises(UserError, match="known views are asked for"):
        digits(views="predicted", anchors=tmp_path / "none.npz", steps=1)


@pytest.mark.parametrize("views, disc", [("known", False), ("direct", False), ("predicted", True), ("learned", True)])
def test_images_of_unknown_directions_are_where_all_lines_see_them(views: Views, disc: bool) -> None:
    x = digits(views=views, size=16, bins=4, steps=1).generator().sample(4)
    assert bool((x[..., 0, 0] == 0).all() and (x[..., 1, 1] == 0).all()) == disc and bool((x[..., 8, :] > 0).all())


def test_images_that_discriminators_see_are_shifted_by_a_sixteenth_of_their_width() -> None:
    assert digits(size=16, views="direct", steps=1).augmentation == Shift(1.0)
    assert digits(size=32, views="direct", steps=1).augmentation == Shift(2.0)
    assert digits(size=16, shift=0.5, views="predicted", steps=1).augmentation == Shift(0.5)
    assert digits(size=16, views="predicted", steps=1).augmentation is None
    assert digits(size=16, steps=1).augmentation is None
    assert digits(size=16, shift=0.0, views="direct", steps=1).augmentation is None


def test_gradients_of_lines_are_penalised_alike_whatever_is_known() -> None:
    recipes = [digits(size=16, views=views, steps=1) for views in ("predicted", "known", "learned")]
    deviation = digits(size=16, steps=1, gamma=1.0).penalty
    assert isinstance(deviation, R1R2)
    for recipe in recipes:
        assert isinstance(recipe.penalty, R1R2) and recipe.penalty.gamma == pytest.approx(0.3 * deviation.gamma)


def test_unknown_directions_are_predicted_all_along_by_one_who_knows_the_symmetry() -> None:
    recipe = digits(views="predicted", size=16, bins=3, tries=2, information=0.2, steps=1)
    assignment = only_panel(recipe).assignment
    assert isinstance(assignment, JointlyPredicted) and assignment.weight == 0.2
    assert assignment.fit.mirrored == (3, 4, 5, 0, 1, 2) and assignment.estimator.window == 3
    assert recipe.tries == Tries(2) and digits(size=16, steps=1).tries is None
