"""Environments: looked up where they lie, sampled with the density they state, turned, and exposed."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.ops.environment import exposure, look_up, prepare_environments, sample_environments, solid_angles
from unproject.ops.plane import towards

ROWS, COLUMNS = 8, 16


def radiance(count: int = 2) -> Tensor:
    return torch.rand(count, 3, ROWS, COLUMNS, generator=generator_at(0), dtype=torch.float64) ** 3


def sphere(n: int) -> tuple[Tensor, Tensor]:
    """(1, 2 n², 3) directions and their solid angle."""
    theta = (torch.arange(n, dtype=torch.float64) + 0.5) * math.pi / n
    phi = (torch.arange(2 * n, dtype=torch.float64) + 0.5) * math.pi / n
    t, p = (x.flatten() for x in torch.meshgrid(theta, phi, indexing="ij"))
    return towards(t, p)[None], t.sin() * (math.pi / n) ** 2


def one(value: float = 0.0) -> Tensor:
    return torch.tensor([value], dtype=torch.float64)


def test_texels_are_where_their_centres_are() -> None:
    """Row 0 at the normal; columns from φ = 0."""
    maps = radiance()
    theta = (torch.arange(ROWS, dtype=torch.float64) + 0.5) * math.pi / ROWS
    phi = (torch.arange(COLUMNS, dtype=torch.float64) + 0.5) * 2 * math.pi / COLUMNS
    t, p = torch.meshgrid(theta, phi, indexing="ij")
    seen, _ = look_up(prepare_environments(maps), torch.tensor([1]), one(), towards(t.flatten(), p.flatten())[None])
    torch.testing.assert_close(seen[0].T.view(3, ROWS, COLUMNS), maps[1], rtol=1e-9, atol=1e-9)


def test_a_turned_light_is_seen_turned() -> None:
    ready, (d, _), turn = prepare_environments(radiance()), sphere(12), 0.7
    turned, _ = look_up(ready, torch.tensor([0]), one(turn), d)
    c, s = math.cos(turn), math.sin(turn)
    back = torch.stack([c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0], d[..., 2]], -1)
    torch.testing.assert_close(turned, look_up(ready, torch.tensor([0]), one(), back)[0], rtol=1e-6, atol=1e-9)


def test_the_density_is_one() -> None:
    d, weight = sphere(400)
    for k in range(2):
        density = look_up(prepare_environments(radiance()), torch.tensor([k]), one(1.0), d)[1]
        assert (density[0] * weight).sum().item() == pytest.approx(1, abs=1e-4)


def test_samples_have_the_density() -> None:
    """The mean of g/p over samples is ∫ g, for g of every shape: radiance squared, halves of the sphere, a cosine."""
    ready, n = prepare_environments(radiance()), 200_000
    u = torch.rand(1, n, 3, generator=generator_at(1), dtype=torch.float64)
    drawn = sample_environments(ready, torch.tensor([1]), one(2.0), u)
    torch.testing.assert_close(drawn.norm(dim=-1), torch.ones(1, n, dtype=torch.float64))
    d, weight = sphere(400)
    for g in (
        lambda x, seen: seen[..., 0] ** 2,
        lambda x, seen: seen[..., 2] * (x[..., 0] > 0.2),
        lambda x, seen: seen[..., 1] * (x[..., 2] + 1) ** 2,
    ):
        seen, density = look_up(ready, torch.tensor([1]), one(2.0), drawn)
        estimate = (g(drawn, seen) / density)[0]
        seen, _ = look_up(ready, torch.tensor([1]), one(2.0), d)
        exact = (g(d, seen)[0] * weight).sum()
        assert abs(estimate.mean() - exact) < 4 * estimate.std() / n**0.5


@pytest.mark.parametrize("row", [0, ROWS - 1])
def test_samples_of_a_texel_at_a_pole_stay_on_its_side(row: int) -> None:
    """What a tent carries over the pole is folded back to the azimuth that it came from."""
    maps = torch.zeros(1, 3, ROWS, COLUMNS, dtype=torch.float64)
    maps[..., row, 4] = 1
    u = torch.rand(1, 5000, 3, generator=generator_at(1), dtype=torch.float64)
    drawn = sample_environments(prepare_environments(maps), torch.tensor([0]), one(), u)[0]
    phi = 4.5 * 2 * math.pi / COLUMNS
    assert (drawn[:, 0] * math.cos(phi) + drawn[:, 1] * math.sin(phi)).min() > 0
    assert (drawn[:, 2].abs() > math.cos(1.5 * math.pi / ROWS)).all()


def test_exposure_makes_any_light_as_strong_as_ambient() -> None:
    maps = radiance(3) * torch.tensor([1.0, 7.0, 0.01])[:, None, None, None]
    exposed = maps * exposure(maps)[:, None, None, None]
    above = (exposed.mean(1)[:, : ROWS // 2] * solid_angles(ROWS, COLUMNS)[: ROWS // 2]).sum((1, 2))
    torch.testing.assert_close(above, torch.full((3,), 2 * math.pi, dtype=torch.float64))
    assert exposure(torch.ones(1, 3, 6, 12)).item() == pytest.approx(1)
    assert exposure(torch.ones(1, 3, 5, 10)).item() == pytest.approx(1)
    assert solid_angles(7, 14).sum().item() == pytest.approx(4 * math.pi)


def test_slopes_are_finite_at_the_poles() -> None:
    d = torch.tensor([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1e-9, 0.0, 1.0]]], dtype=torch.float64, requires_grad=True)
    seen, density = look_up(prepare_environments(radiance()), torch.tensor([0]), one(), d)
    (slope,) = torch.autograd.grad(seen.sum() + density.sum(), d)
    assert slope.isfinite().all()


@pytest.mark.parametrize(
    "maps",
    [torch.ones(3, 8, 16), torch.zeros(1, 3, 8, 16), -torch.ones(1, 3, 8, 16), torch.full((1, 3, 8, 16), math.nan)],
)
def test_what_is_no_light_is_refused(maps: Tensor) -> None:
    with pytest.raises(UserError, match="environments"):
        prepare_environments(maps)
