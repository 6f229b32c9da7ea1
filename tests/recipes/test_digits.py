"""The digits recipes: line integrals of images paired with directions, four arms by one flag."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from unproject.adversarial.assignment import Known, Predicted
from unproject.adversarial.learned_prior import LearnedPrior

from unproject._types import UserError
from unproject.data import digits as embedded
from unproject.data.readers.images import fitted
from unproject.projections.base import Identity
from unproject.recipes import find
from unproject.recipes.digits import digits, digits_paper
from unproject.recipes.pairing import Views


@pytest.mark.parametrize(
    "recipe, views, looks, lines, assignment",
    [
        (digits, "known", 10, 1500, Known),
        (digits, "predicted", 20, 1500, Predicted),  # anywhere around
        (digits, "learned", 20, 1500, LearnedPrior),
        (digits, "single", 1, 1500, Known),
        (digits_paper, "known", 10, 1500, Known),
        (digits_paper, "predicted", 10, 1500, Predicted),
        (digits_paper, "learned", 10, 1500, LearnedPrior),
        (digits_paper, "single", 1, 1500, Known),
    ],
)
def test_the_arms(recipe, views: Views, looks: int, lines: int, assignment: type) -> None:  # type: ignore[no-untyped-def]
    made = recipe(views=views, size=16, steps=1)
    assert len(made.looks) == looks and isinstance(made.assignment, assignment)
    assert all(collection.items.shape[1:] == (1, 16) for _, collection in made.looks)
    different = {id(collection): len(collection) for _, collection in made.looks}
    assert sum(different.values()) == lines


def test_direct_training_sees_the_images() -> None:
    ((look, collection),) = digits(views="direct", size=16, steps=1).looks
    assert isinstance(look.projection, Identity) and torch.equal(collection.items, embedded(16))


def test_known_lines_are_the_line_integrals_of_the_images_in_their_direction() -> None:
    """A line integral keeps the whole mass of an image that lies within the detectors, whatever its direction."""
    looks = digits(size=16, steps=1).looks
    for look, collection in looks:
        assert look.prior.contains(collection.latents).all()
    rows = [int(name.split("#")[0]) for _, collection in looks for name in collection.names]
    seen = torch.cat([collection.items.mean(2)[:, 0] for _, collection in looks])
    torch.testing.assert_close(seen, embedded(16)[rows].mean((1, 2, 3)), rtol=1e-2, atol=1e-3)
    assert sorted(rows) == list(range(1500))


def test_several_looks_at_each_image() -> None:
    assert sum(len(c) for _, c in digits(size=16, looks_per_image=3, steps=1).looks) == 4500


def test_an_idx_file_gets_a_margin(tmp_path: Path) -> None:
    images = np.random.default_rng(0).integers(0, 256, (5, 28, 28), dtype=np.uint8)
    header = struct.pack(">BBBBIII", 0, 0, 8, 3, *images.shape)
    (tmp_path / "some-idx3-ubyte.gz").write_bytes(gzip.compress(header + images.tobytes()))
    ((_, collection),) = digits(data=tmp_path / "some-idx3-ubyte.gz", views="direct", steps=1).looks
    assert collection.items.shape == (5, 1, 32, 32)
    torch.testing.assert_close(collection.floats()[:, 0, 2:30, 2:30], torch.from_numpy(images / 255.0).float())
    assert not collection.items[:, 0, :2].any() and not collection.items[:, 0, :, 30:].any()


def test_larger_pictures_are_resampled(tmp_path: Path) -> None:
    np.savez(tmp_path / "large.npz", images=np.ones((3, 64, 64), np.float32))
    ((_, collection),) = digits(data=tmp_path / "large.npz", views="direct", size=32, steps=1).looks
    torch.testing.assert_close(collection.items, torch.ones(3, 1, 32, 32))


def test_an_odd_margin() -> None:
    assert torch.equal(fitted(torch.ones(1, 1, 1, 2), 4)[0, 0].nonzero(), torch.tensor([[1, 1], [1, 2]]))


def test_volumes_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "volumes.npz", volume=np.ones((3, 16, 16, 16), np.float32))
    with pytest.raises(UserError, match="holds volumes; images are learned from"):
        digits(data=tmp_path / "volumes.npz", steps=1)


def test_they_are_found_by_name() -> None:
    assert find("digits") is digits and find("digits-paper") is digits_paper


def test_measured_lines_are_used_as_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines, angle = rng.random((40, 48), np.float32), rng.integers(10, size=40) * np.pi / 10 + 0.01
    np.savez(tmp_path / "scans.npz", lines=lines, angle=angle)
    made = digits(data=tmp_path / "scans.npz", steps=1)
    for look, collection in made.looks:
        rows = [int(name) for name in collection.names]
        assert look.prior.contains(collection.latents).all() and collection.items.shape[1:] == (1, 48)
        assert np.allclose(collection.items[:, 0].numpy(), lines[rows])
    assert sum(len(collection) for _, collection in made.looks) == 40
    (look, collection), *others = digits(data=tmp_path / "scans.npz", views="predicted", steps=1).looks
    assert len(others) == 19 and np.allclose(collection.items[:, 0].numpy(), lines)
    assert look.projection(torch.rand(2, 1, 32, 32), angle=torch.zeros(2)).shape == (2, 1, 48)
    with pytest.raises(UserError, match="direct training needs images"):
        digits(data=tmp_path / "scans.npz", views="direct", steps=1)


def test_lines_without_directions_are_for_predicted_ones(tmp_path: Path) -> None:
    np.savez(tmp_path / "scans.npz", lines=np.random.default_rng(0).random((40, 1, 16), np.float32))
    assert digits(data=tmp_path / "scans.npz", views="predicted", steps=1).looks[0][1].items.shape == (40, 1, 16)
    with pytest.raises(UserError, match="known views are asked for .* `angle`"):
        digits(data=tmp_path / "scans.npz", steps=1)
    np.savez(tmp_path / "scans.npz", lines=np.zeros((4, 2, 16), np.float32))
    with pytest.raises(UserError, match=r"line integrals are \(N, D\)"):
        digits(data=tmp_path / "scans.npz", steps=1)
