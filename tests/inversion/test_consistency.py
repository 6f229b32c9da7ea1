"""Data consistency: linear readings are kept as far as they are no noise, and the rest is the sample's."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject.data import digits
from unproject.inversion import Fitter, Search, Viewing, consistency, fitter
from unproject.inversion.consistency import Readings
from unproject.projections import LineIntegral, Observation, directions
from unproject.projections.base import Identity

from .test_fitter import SIDE, Discs, Seats, one_seat, seats

ANGLE = torch.tensor([0.0, 0.9, 1.7])
UNBOUNDED = (-math.inf, math.inf)


def readings(angle: Tensor = ANGLE) -> Readings:
    def project(x: Tensor, which: Tensor) -> Tensor:
        return LineIntegral()(x, angle=angle[which])

    return Readings.of(project, len(angle), torch.Size((1, SIDE, SIDE)))


def noise(like: Tensor, deviation: float) -> Tensor:
    return deviation * torch.randn(like.shape, generator=torch.Generator().manual_seed(0), dtype=like.dtype)


def test_the_matrix_is_the_projection() -> None:
    x = digits(SIDE)[3].double()
    seen = LineIntegral()(x.expand(3, -1, -1, -1), angle=ANGLE)
    torch.testing.assert_close(readings().matrix @ x.flatten(), seen.flatten(), atol=1e-9, rtol=0)


def test_readings_without_noise_are_met_within_the_bounds() -> None:
    of, true = readings(), digits(SIDE)[3].double().flatten()
    x = of.completed(torch.full_like(true, 0.3)[None], of.matrix @ true, (0.0, 1.0))[0]
    assert (of.matrix @ (x - true)).abs().max() < 1e-4
    assert x.min() >= 0 and x.max() <= 1
    free = of.completed(torch.full_like(true, 0.3)[None], of.matrix @ true, UNBOUNDED)[0]
    assert free.min() < -0.01


@pytest.mark.parametrize("unit", [1.0, 40.0])
def test_noise_is_told_from_what_the_sample_lacks(unit: float) -> None:
    of = Readings(unit * readings(torch.arange(8) * math.pi / 8).matrix)
    true = digits(SIDE)[3].double().flatten()
    g = torch.full_like(true, 0.3)
    y, last = of.matrix @ true, 0.0
    for deviation in (0.02, 0.1, 0.5):
        given = y + noise(y, unit * deviation)
        mu = of.noise(given - of.matrix @ g)
        assert mu > 2 * last
        last = mu
        misfit = (of.matrix @ of.completed(g[None], given, UNBOUNDED)[0] - given).square().mean().sqrt() / unit
        assert 0.2 * deviation < misfit < 1.5 * deviation


def test_more_readings_than_pixels_are_weighed_as_few_are() -> None:
    """The noise of 24 angles of 16 detectors, by the Gram matrix of 256 pixels and by that of 384 readings."""
    of = readings(torch.arange(24) * math.pi / 24)
    true = digits(SIDE)[3].double().flatten()
    given = of.matrix @ true + noise(of.matrix @ true, 0.05)
    misfit = given - of.matrix @ torch.full_like(true, 0.3)
    values, vectors = torch.linalg.eigh(of.matrix @ of.matrix.T)
    square = (vectors.T @ misfit).square()

    def evidence(mu: float) -> float:
        total = values.clamp_min(0) + mu
        return (-len(misfit) / 2 * (square / total).mean().log() - total.log().sum() / 2).item()

    grid = [values.mean().item() * share for share in consistency.NOISE]
    assert of.noise(misfit) == pytest.approx(max(grid, key=evidence))
    assert len(of.spectrum[0]) == 256 < len(misfit)


def test_what_no_reading_tells_is_left_as_it_was() -> None:
    of, true = readings(), digits(SIDE)[3].double().flatten()
    g = noise(true, 1.0)
    y = of.matrix @ true
    x = of.completed(g[None], y + noise(y, 0.3), UNBOUNDED)[0]
    unseen = torch.eye(len(true), dtype=torch.double) - torch.linalg.pinv(of.matrix, rtol=1e-6) @ of.matrix
    torch.testing.assert_close(unseen @ x, unseen @ g, atol=1e-4, rtol=0)
    assert (x - g).abs().max() > 0.1


def spotted() -> tuple[Tensor, Tensor]:
    """A disc with a hole, which no code makes, and its lines."""
    x = Discs()(torch.tensor([[0.5, -0.5, 0.5]])).detach()
    x[:, :, 6:8, 7:9] = 0
    return x, LineIntegral()(x.expand(3, -1, -1, -1), angle=ANGLE)


def found(pictures: Tensor, known: dict[str, Tensor], **flags: bool) -> fitter.Fit:
    viewing = Viewing.of(directions(4, line_integral=LineIntegral()))
    return Fitter(Discs(), viewing, Search(tune=0, candidates=16, starts=2, steps=40, prior=0.01, **flags)).fit(
        pictures, known
    )


def test_a_fit_agrees_with_lines_of_known_angles_and_still_says_how_far_the_generator_is() -> None:
    x, pictures = spotted()
    plain, kept = (found(pictures, {"angle": ANGLE}, consistent=on) for on in (False, True))
    assert kept.consistent and not plain.consistent
    torch.testing.assert_close(kept.projected, pictures, atol=2e-3, rtol=0)
    torch.testing.assert_close(kept.distance, plain.distance)
    assert (plain.projected - pictures).abs().max() > 0.02
    assert (kept.x[0] - x[0]).square().mean() < 0.7 * (plain.x[0] - x[0]).square().mean()
    assert kept.x.min() >= 0 and kept.x.max() <= 1


def test_readings_of_the_same_angles_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made, of = [], Readings.of
    monkeypatch.setattr(Readings, "of", lambda *given: made.append(given) or of(*given))
    fitter = Fitter(Discs(), Viewing.of(directions(4)), Search(tune=0, candidates=8, starts=1, steps=2))
    _, pictures = spotted()
    for angle in (ANGLE, ANGLE, ANGLE + 0.1):
        assert fitter.fit(pictures, {"angle": angle}).consistent
    assert len(made) == 2


def test_of_what_is_seen_itself_nothing_tells_noise() -> None:
    x, _ = spotted()
    fitter = Fitter(
        Discs(), Viewing.of([Observation("itself", Identity())]), Search(tune=0, candidates=8, starts=1, steps=2)
    )
    assert not fitter.fit(x).consistent


def test_nothing_is_completed_of_unknown_angles_or_of_silhouettes(monkeypatch: pytest.MonkeyPatch) -> None:
    _, pictures = spotted()
    assert not found(pictures, {}).consistent
    _, silhouettes, known = one_seat(seats(), [0.3, 1.2])
    assert (
        not Fitter(Seats(), seats(), Search(tune=0, candidates=4, starts=1, steps=1)).fit(silhouettes, known).consistent
    )
    monkeypatch.setattr(fitter, "MAX_ENTRIES", 3 * SIDE**3 - 1)
    assert not found(pictures, {"angle": ANGLE}).consistent
    monkeypatch.setattr(fitter, "MAX_ENTRIES", 3 * SIDE**3)
    monkeypatch.setattr(consistency, "AT_ONCE", 7)
    assert found(pictures, {"angle": ANGLE}).consistent
