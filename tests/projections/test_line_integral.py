"""Line integrals as a projection, and the ten directions."""

from __future__ import annotations

import math

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.projections.line_integral import LineIntegral, directions, opposite_directions


def images(n: int) -> torch.Tensor:
    return torch.rand(n, 1, 8, 8, generator=generator_at(0))


def test_one_detector_a_pixel_unless_given() -> None:
    assert LineIntegral()(images(2), angle=torch.zeros(2)).shape == (2, 1, 8)
    assert LineIntegral(bins=5)(images(2), angle=torch.zeros(2)).shape == (2, 1, 5)


def test_both_paths_see_the_same() -> None:
    angle = torch.linspace(-4, 4, 9)
    fast, plain = (LineIntegral(fast=fast)(images(9), angle=angle) for fast in (True, False))
    torch.testing.assert_close(fast, plain, rtol=0, atol=1e-6)


def test_the_other_way_round_is_flipped() -> None:
    angle = torch.tensor([0.4, 2.0])
    here, there = (LineIntegral()(images(2), angle=a) for a in (angle, angle + math.pi))
    torch.testing.assert_close(here, there.flip(2), rtol=0, atol=1e-6)


def test_an_angle_that_is_learned_gets_its_gradient() -> None:
    angle = torch.tensor([0.4, 2.0], requires_grad=True)
    LineIntegral()(images(2), angle=angle)[..., 3].sum().backward()
    assert angle.grad is not None and angle.grad.all()


def test_ten_directions_over_half_a_turn() -> None:
    observations = directions()
    assert [observation.name for observation in observations[:2]] == ["direction-00", "direction-01"] and len(
        observations
    ) == 10
    for k, observation in enumerate(observations):
        drawn = observation.prior.sample(1000, generator_at(k))["angle"].rad2deg()
        assert drawn.min() >= 18 * k - 2.5 and drawn.max() < 18 * k + 2.5 and drawn.max() - drawn.min() > 4.9
        assert [other.prior.contains({"angle": drawn.deg2rad()}).all() for other in observations].index(True) == k


def test_a_whole_turn_of_directions() -> None:
    half, whole = directions(5, 0.1), directions(5, 0.1, whole=True)
    assert len(whole) == 10 and whole[:5] == half
    for k in range(5):
        opposite = whole[k].prior.sample(100, generator_at(k))["angle"] + torch.pi
        assert whole[k + 5].prior.contains({"angle": opposite}).all()


@pytest.mark.parametrize(
    "make",
    [
        lambda: LineIntegral(bins=0),
        lambda: LineIntegral(center=9).from_measured(torch.zeros(1, 1, 8)),
        lambda: LineIntegral(unit=0.0),
        lambda: LineIntegral(unit=math.nan),
        lambda: directions(0),
        lambda: opposite_directions(0),
        lambda: directions(10, 0.2),
        lambda: LineIntegral()(images(2), angle=torch.zeros(3)),
        lambda: LineIntegral()(images(2)[0], angle=torch.zeros(1)),
    ],
)
def test_mistakes(make) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UserError, match="give"):
        make()


def test_opposite_directions_show_the_same_backwards() -> None:
    x = torch.rand(1, 1, 12, 12, generator=torch.Generator().manual_seed(0))
    around = directions(5, 0.0, LineIntegral(), whole=True)
    lines = [seen.projection(x, **seen.prior.sample(1, torch.Generator())) for seen in around]
    for k, opposite in enumerate(opposite_directions(5)):
        torch.testing.assert_close(lines[opposite], lines[k].flip(-1), atol=1e-4, rtol=0)
