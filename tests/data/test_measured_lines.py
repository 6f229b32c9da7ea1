"""Measured lines: any center, half turn and unit, as other libraries make them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage.transform import radon
from torch import Tensor

from unproject._types import UserError
from unproject.data import Collection, inspect
from unproject.data.measured_lines import (
    are_intensities,
    center_of,
    scale_of,
    standardised_lines,
    within_half_turn,
)
from unproject.ops.detectors import about_middle
from unproject.projections.line_integral import LineIntegral, directions

RNG = np.random.default_rng(0)
WAVES = torch.linspace(0, 40, 128).sin().view(8, 1, 16)


def an_image(size: int) -> Tensor:
    """Bars without any symmetry, within the circle."""
    x = torch.zeros(1, 1, size, size)
    x[..., size // 4 : 5 * size // 8, size // 3 : size // 2] = 1
    x[..., size // 2 : 5 * size // 8, size // 3 : 3 * size // 4] = 0.7
    return x


def seen(x: Tensor, angles: Tensor) -> Tensor:
    return LineIntegral()(x.expand(len(angles), *x.shape[1:]), angle=angles.float())


@pytest.mark.parametrize("size", [32, 33])
def test_the_lines_of_scikit_image(size: int) -> None:
    """The same angles; sums of pixels; the axis at detector D // 2, half a pixel from the middle if D is even."""
    x, degrees = an_image(size), np.arange(-90, 360, 7.0)
    theirs = radon(x[0, 0].numpy().astype(float), degrees, circle=True)
    lines = about_middle(torch.from_numpy(theirs.T[:, None]).float(), size // 2)
    wider = torch.nn.functional.pad(x, (0, 1 - size % 2, 0, 1 - size % 2))  # its middle is that pixel's
    ours = seen(wider, torch.from_numpy(np.deg2rad(degrees)))
    assert (lines / wider.shape[-1] - ours).abs().max() < 0.02 and ours.max() > 0.3
    off = torch.from_numpy(theirs.T[:, None] / size).float()
    if size % 2 == 0:
        assert (off - seen(x, torch.from_numpy(np.deg2rad(degrees)))).abs().max() > 0.2


def test_the_lines_of_deepinv() -> None:
    """The same angles; sums of pixels; the axis in the middle: what deepinv 0.5.0's Radon(6, circle=True) makes."""
    x = torch.zeros(1, 1, 6, 6)
    x[..., 1, 1], x[..., 2:4, 3] = 1, 0.5
    theirs = torch.tensor(
        [
            [0.0, 1.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0221, 0.9824, 0.7859, 0.0715, 0.0],
            [0.0, 0.0, 0.5, 0.5, 1.0, 0.0],
            [0.0, 0.0715, 0.5380, 0.3505, 0.3971, 0.5048],
        ]
    )
    ours = seen(x, torch.tensor([0.0, 30.0, 90.0, 120.0]).deg2rad())[:, 0] * 6
    torch.testing.assert_close(ours[::2], theirs[::2], atol=1e-5, rtol=0)
    torch.testing.assert_close(ours, theirs, atol=0.08, rtol=0)  # it interpolates where ours are exact


@pytest.mark.parametrize("center", [0, 3, 7, 7.5, 8, 11.5, 15])
def test_lines_are_moved_without_loss_to_half_a_detector(center: float) -> None:
    lines = torch.rand(4, 1, 16)
    moved = about_middle(lines, center)
    middle = (moved.shape[-1] - 1) / 2
    begin = int(middle - center)
    assert middle - center == begin and torch.equal(moved[..., begin : begin + 16], lines)
    assert moved.sum() == pytest.approx(lines.sum().item()) and about_middle(lines, None) is lines


@pytest.mark.parametrize("center", [6.9, 7.2, 8.6])
def test_lines_are_interpolated_in_between(center: float) -> None:
    """The centre of mass of a spot at the axis is the middle."""
    lines = torch.zeros(1, 1, 16)
    below = int(center)
    lines[..., below], lines[..., below + 1] = 1 - (center - below), center - below
    moved = about_middle(lines, center)[0, 0]
    place = (moved * torch.arange(len(moved))).sum() / moved.sum()
    assert place == pytest.approx((len(moved) - 1) / 2, abs=1e-5)


@pytest.mark.parametrize("center", [-0.5, 15.5, math.nan])
def test_a_center_beside_the_detectors_is_refused(center: float) -> None:
    with pytest.raises(UserError, match="give a detector of those there are, 0 to 15"):
        about_middle(torch.rand(2, 1, 16), center)


def test_every_angle_lies_in_one_of_the_directions_and_shows_the_same() -> None:
    """Multiples of a degree, in which bounds are, and any others; several turns, both ways."""
    x = an_image(16)
    angle = torch.cat([torch.arange(-720, 720).float().deg2rad(), torch.from_numpy(RNG.uniform(-9, 9, 300)).float()])
    for count in (1, 3, 10):
        half = math.pi / 2 / count
        lines, folded = within_half_turn(seen(x, angle), angle, half)
        inside = torch.stack([d.prior.contains({"angle": folded}) for d in directions(count, half)])
        assert bool((inside.sum(0) == 1).all())
        torch.testing.assert_close(lines, seen(x, folded), atol=2e-4, rtol=0)


def test_readings_of_any_unit_come_to_image_widths() -> None:
    lines = torch.from_numpy(RNG.random((50, 1, 32))).float() * 0.6
    assert scale_of(Collection(lines)) == 1
    for unit in (1e-4, 30.0, 1e6):
        found = scale_of(Collection(lines * unit))
        assert lines.max() * unit / found == pytest.approx(0.5, abs=0.02)
    noisy = lines + 0.02 * torch.from_numpy(RNG.standard_normal(lines.shape)).float()
    assert noisy.min() < 0 and scale_of(Collection(noisy)) == 1
    spiked = lines.clone()
    spiked[3, 0, 5] = 500.0  # a single broken detector
    assert scale_of(Collection(spiked * 10)) == pytest.approx(12, rel=0.05)


@pytest.mark.parametrize("lines", [WAVES * 0, WAVES, WAVES - 1], ids=["nothing", "about 0", "below 0"])
def test_what_is_no_line_integral_is_refused(lines: Tensor) -> None:
    with pytest.raises(UserError, match=r"readings run from .*: take -log\(I / I0\)"):
        scale_of(Collection(lines))


def test_a_collection_keeps_its_names_and_other_latents() -> None:
    latents = {"angle": torch.tensor([0.1, 0.1 + math.pi]), "view": torch.tensor([3.0, 4.0])}
    found = Collection(30 * torch.rand(2, 1, 8), names=["a", "b"], latents=latents, source="s")
    scale = scale_of(found)
    made = standardised_lines(found, 4, scale, center=4)
    assert made.names == ("a", "b") and made.source == "s" and made.shape == (1, 9)
    assert made.latents is not None and made.latents["view"].tolist() == [3, 4]
    torch.testing.assert_close(made.latents["angle"], torch.tensor([0.1, 0.1]))
    torch.testing.assert_close(made.items[0, 0, :8] * scale, found.items[0, 0])
    torch.testing.assert_close(made.items[1, 0, 1:].flip(-1) * scale, found.items[1, 0])
    assert standardised_lines(Collection(torch.rand(2, 1, 8)), 4).latents is None


def discs(count: int, detectors: int, center: float) -> tuple[Tensor, Tensor]:
    """Lines of one disc each, anywhere near the axis, and their angles."""
    rng = torch.Generator().manual_seed(0)
    angle = math.pi * torch.rand(count, generator=rng)  # half a turn: the mean of sines is not 0
    x, y = 0.2 * detectors * (torch.rand(2, count, generator=rng) - 0.3)
    place = torch.arange(detectors) - (center + x * angle.cos() + y * angle.sin())[:, None]
    return (9 - place.square()).clamp(0).sqrt()[:, None], angle


def test_the_axis_is_found_by_the_centroids() -> None:
    for center in (15.5, 18.2):
        found, error = center_of(*discs(2000, 32, center))
        assert abs(found - center) < 3 * error and error < 0.5


@pytest.mark.parametrize("angles", [[0.0], [0.0, math.pi / 2], [0.0, 0.02]])
def test_the_axis_is_not_found_from_two_directions(tmp_path: Path, angles: list[float]) -> None:
    """Radiographs from the front and from the side: the axis is in the middle, and --center would move it."""
    angle = torch.tensor(angles).repeat(60 // len(angles))
    lines = seen(an_image(16), angle) * (1 + torch.rand(60, 1, 16, generator=torch.Generator().manual_seed(0)))
    assert center_of(lines, angle)[1] > 1e4
    np.savez(tmp_path / "x.npz", lines=lines[:, 0].numpy(), angle=angle.numpy())
    assert "the axis of rotation" not in "\n".join(inspect(tmp_path / "x.npz").summary())


def test_intensities_are_told_from_line_integrals() -> None:
    lines, angle = discs(100, 32, 15.5)
    assert are_intensities((-lines).exp()) and not are_intensities(lines)
    measured = Collection((-lines).exp(), latents={"angle": angle})
    with pytest.warns(UserWarning, match="higher at both ends than in the middle"):
        standardised_lines(measured, 10)


def test_inspect_says_where_the_axis_seems_to_be(tmp_path: Path) -> None:
    for center, said in ((15.5, False), (18.2, True)):
        lines, angle = discs(400, 32, center)
        np.savez(tmp_path / "x.npz", lines=lines[:, 0].numpy(), angle=angle.numpy())
        told = "\n".join(inspect(tmp_path / "x.npz").summary())
        assert ("the axis of rotation seems to project to detector 18." in told) == said
    np.savez(tmp_path / "x.npz", lines=(-lines[:, 0]).exp().numpy())
    assert "as intensities are: take -log" in "\n".join(inspect(tmp_path / "x.npz").summary())
