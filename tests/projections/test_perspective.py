"""Cameras of photographs: perspective and roll of each picture, as latents of a silhouette."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.ops import rotate_image
from unproject.ops.resampling import centres
from unproject.projections.observation import Observation
from unproject.projections.priors import Product, Uniform
from unproject.projections.silhouette import RULES, Silhouette
from unproject.testing import check_projection

Latents = dict[str, torch.Tensor]
PHOTOGRAPHER = Product(
    Uniform("azimuth", 0, 6.28),
    Uniform("elevation", -1.5, 1.5),
    Uniform("perspective", 0.05, 0.45),
    Uniform("roll", -3, 3),
)


def views(count: int, **fixed: float) -> Latents:
    drawn = PHOTOGRAPHER.sample(count, generator_at(1))
    return {name: value.double() for name, value in drawn.items()} | {
        name: torch.full((count,), value, dtype=torch.float64) for name, value in fixed.items()
    }


def clouds(count: int, *shape: int) -> torch.Tensor:
    return (torch.rand(count, *(shape or (10, 10, 10)), generator=generator_at(0)) ** 3).double()


@pytest.mark.parametrize("options", [{}, {"size": 7, "viewport": 1.4, "depth_samples": 9}], ids=str)
@pytest.mark.parametrize("rule", RULES)
def test_the_fast_path_is_the_reference_in_values_and_gradients(rule: str, options: dict[str, Any]) -> None:
    results = []
    for fast in (True, False):
        x, theta = clouds(4, 6, 9, 7).requires_grad_(), {k: v.requires_grad_() for k, v in views(4).items()}
        theta["azimuth"].requires_grad_(False)
        y = Silhouette(rule=rule, fast=fast, **options)(x, **theta)
        weight = torch.rand(y.shape, generator=generator_at(2), dtype=y.dtype)
        learned = [x, *(theta[name] for name in ("elevation", "perspective", "roll"))]
        results.append((y, *torch.autograd.grad(y, learned, weight)))
    for quick, plain in zip(*results, strict=True):
        torch.testing.assert_close(quick, plain, atol=1e-8, rtol=1e-6)


@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_gradients_by_each_latent(rule: str) -> None:
    """Against finite differences, in a view and at 0, where a distance would be infinite."""
    x, silhouette = clouds(2, 5, 5, 5), Silhouette(rule=rule, size=4)  # type: ignore[arg-type]
    for theta in (views(2), views(2, perspective=0.2, roll=0.0, elevation=0.3)):
        azimuth = theta.pop("azimuth")
        names, values = list(theta), tuple(value.requires_grad_() for value in theta.values())
        assert torch.autograd.gradcheck(
            lambda *v, a=azimuth, names=names: silhouette(x, azimuth=a, **dict(zip(names, v, strict=True))), values
        )
    flat = torch.zeros(2).double().requires_grad_()
    (slope,) = torch.autograd.grad(silhouette(x, azimuth=azimuth, perspective=flat).sum(), flat)
    step = torch.full((2,), 1e-6).double()
    plain = Silhouette(rule=rule, size=4, fast=False)  # type: ignore[arg-type]
    rise = (plain(x, azimuth=azimuth, perspective=step) - plain(x, azimuth=azimuth)).sum((1, 2, 3)) / step
    torch.testing.assert_close(slope, rise, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_a_pinhole_at_a_great_distance_is_orthographic(rule: str, fast: bool) -> None:
    x, theta = clouds(4), views(4, roll=0.0)
    plain = Silhouette(rule=rule, fast=False)  # type: ignore[arg-type]
    level = plain(x, azimuth=theta["azimuth"], elevation=theta["elevation"])
    far = Silhouette(rule=rule, fast=fast)(x, **theta | {"perspective": torch.full((4,), 1e-9)})  # type: ignore[arg-type]
    torch.testing.assert_close(far, level, atol=1e-6, rtol=0)


def test_it_is_the_fixed_pinhole() -> None:
    x, theta = clouds(3), views(3, perspective=0.4, roll=0.0)
    perspective = theta.pop("perspective")
    for rule in RULES:
        fixed = Silhouette(rule=rule, camera="perspective", distance=2.5)(x, **theta)
        torch.testing.assert_close(Silhouette(rule=rule)(x, **theta, perspective=perspective), fixed, atol=1e-9, rtol=0)


@pytest.mark.parametrize("side, towards", [(11, -1), (52, 1)])
@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_nearer_parts_look_larger(rule: str, side: int, towards: int) -> None:
    """A plate as wide as half the box at depth w, seen with perspective κ, is 1 / (1 - w κ) times as wide."""
    x = torch.zeros(1, 64, 64, 64)
    x[:, 16:48, 16:48, side] = 1
    depth, kappa = float(centres(64, x)[side]), 0.4
    assert math.copysign(1, depth) == towards
    y = Silhouette(rule=rule)(x, azimuth=torch.zeros(1), perspective=torch.tensor([kappa]))  # type: ignore[arg-type]
    seen = (y > 0.3).float().mean().sqrt().item()
    assert seen == pytest.approx(0.5 / (1 - depth * kappa), abs=0.02)
    assert seen > 0.6 if towards > 0 else seen < 0.41


@pytest.mark.parametrize("quarter", [-1, 1, 2])
@pytest.mark.parametrize("rule", RULES)
def test_a_roll_by_a_quarter_turn_turns_the_picture_counter_clockwise(rule: str, quarter: int) -> None:
    x, theta, silhouette = clouds(3), views(3, roll=0.0), Silhouette(rule=rule)
    rolled = silhouette(x, **views(3, roll=quarter * math.pi / 2))
    torch.testing.assert_close(rolled, silhouette(x, **theta).rot90(quarter, (2, 3)), atol=1e-9, rtol=0)


def test_a_small_roll_turns_the_picture() -> None:
    axes = torch.meshgrid(*[centres(32, torch.empty(0))] * 3, indexing="ij")
    x = ((axes[0].abs() < 0.3) & (axes[1].abs() < 0.7) & (axes[2].abs() < 0.1)).float()[None]
    roll = torch.tensor([0.2])
    upright, rolled = (Silhouette(rule="absorption")(x, azimuth=torch.zeros(1), roll=r) for r in (None, roll))
    assert (rolled - rotate_image(upright, roll)).abs().mean() < (rolled - upright).abs().mean() / 2
    torch.testing.assert_close(rolled.mean(), upright.mean(), atol=0.03, rtol=0)


@pytest.mark.parametrize("rule", RULES)
def test_zeros_are_none_bit_for_bit_and_other_pictures_do_not_matter(rule: str) -> None:
    x, theta = clouds(6), views(6)
    silhouette, some = Silhouette(rule=rule), torch.tensor([1.0, 0, 1, 0, 0, 1]).double()
    theta |= {"perspective": theta["perspective"] * some, "roll": theta["roll"] * some.flip(0)}
    together = silhouette(x, **theta)
    alone = [silhouette(x[k : k + 1], **{name: value[k : k + 1] for name, value in theta.items()}) for k in range(6)]
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-9, rtol=0)
    upright = {name: theta[name] for name in ("azimuth", "elevation")}
    zeros = silhouette(x, **upright, perspective=torch.zeros(6), roll=torch.zeros(6))
    assert torch.equal(zeros, silhouette(x, **upright))
    half = torch.tensor([0.0, 0, 1, 1, 1, 1]).double()
    mixed = silhouette(x, **upright, perspective=0.3 * half)
    assert torch.equal(mixed[:2], silhouette(x[:2], **{name: value[:2] for name, value in upright.items()}))


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("fast", [True, False])
def test_the_laws_hold(rule: str, fast: bool) -> None:
    check_projection(Observation("photograph", Silhouette(rule=rule, fast=fast), PHOTOGRAPHER))  # type: ignore[arg-type]


def test_a_prior_may_leave_them_out_but_draw_nothing_else() -> None:
    level = (Uniform("azimuth", 0, 1), Uniform("elevation", 0, 1))
    assert Silhouette().latents == ("azimuth", "elevation")
    Observation("upright", Silhouette(), Product(*level))
    Observation("rolled", Silhouette(), Product(*level, Uniform("roll", 0, 1)))
    for wrong in (Product(*level, Uniform("yaw", 0, 1)), Product(level[0], Uniform("roll", 0, 1))):
        with pytest.raises(UserError, match=r"draw just those, and any of \['perspective', 'roll'\]"):
            Observation("wrong", Silhouette(), wrong)


@pytest.mark.parametrize(
    "latents, message",
    [
        ({"perspective": torch.tensor([0.1, 0.46])}, "perspective is one over the pinhole's distance: give 0 to 0.45"),
        ({"perspective": torch.tensor([0.1, -0.1])}, "give 0 to 0.45"),
        ({"perspective": torch.tensor([0.1, math.nan])}, "give 0 to 0.45"),
        ({"perspective": torch.tensor(0.1)}, r"one perspective a volume: \(2,\), not \(\)"),
        ({"roll": torch.zeros(3)}, r"one roll a volume: \(2,\), not \(3,\)"),
    ],
)
def test_bad_latents_say_what_is_wanted(latents: Latents, message: str) -> None:
    with pytest.raises(UserError, match=message):
        Silhouette()(torch.zeros(2, 8, 8, 8), azimuth=torch.zeros(2), **latents)


def test_the_fixed_pinhole_rolls_but_stays() -> None:
    x, look = clouds(2), Silhouette(camera="perspective")
    azimuth, quarter = torch.zeros(2), torch.full((2,), math.pi / 2, dtype=torch.float64)
    torch.testing.assert_close(look(x, azimuth=azimuth, roll=quarter), look(x, azimuth=azimuth).rot90(1, (2, 3)))
    with pytest.raises(UserError, match="this pinhole has its `distance`"):
        look(x, azimuth=azimuth, perspective=torch.full((2,), 0.1))


@pytest.mark.parametrize("camera", ["orthographic", "perspective"])
def test_a_batch_of_nothing_has_no_silhouettes(camera: Any) -> None:
    y = Silhouette(size=8, camera=camera)(torch.zeros(0, 8, 8, 8), azimuth=torch.zeros(0))
    assert y.shape == (0, 1, 8, 8)
