"""Microfacets: published values, conservation of energy, reciprocity, and samplers that draw what they say."""

from __future__ import annotations

import math

import pytest
import torch
from scipy import stats
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.ops.microfacet import (
    Reflection,
    beckmann,
    cook_torrance_over_cos,
    cosine_density,
    half_vector,
    lobe_density,
    reflect,
    reflectance,
    sample_beckmann,
    sample_cosine,
    schlick,
    smith_over_cos,
    tan_squared,
)

M = torch.tensor(0.1, dtype=torch.float64)
ROUGHNESS = (0.02, 0.05, 0.1, 0.3, 0.6, 1.0)
VIEWS = (0.0, 45.0, 75.0, 85.0)


def cos(angle: float) -> Tensor:
    return torch.tensor(angle, dtype=torch.float64).cos()


def view(degrees: float) -> Tensor:
    return torch.tensor([math.sin(math.radians(degrees)), 0.0, math.cos(math.radians(degrees))], dtype=torch.float64)


def squares(n: int, seed: int) -> tuple[Tensor, Tensor]:
    return torch.rand(2, n, generator=generator_at(seed), dtype=torch.float64).unbind(0)


def grid(n: int) -> tuple[Tensor, Tensor]:
    """(n² of) cosθ evenly in [0, 1] and φ: the upper hemisphere, each point 2π/n² sr."""
    at = (torch.arange(n, dtype=torch.float64) + 0.5) / n
    return at.repeat_interleave(n), 2 * math.pi * at.repeat(n)


def hemisphere(n: int) -> Tensor:
    z, phi = grid(n)
    r = (1 - z.square()).sqrt()
    return torch.stack([r * phi.cos(), r * phi.sin(), z], -1)


def test_beckmann_has_the_published_values() -> None:
    assert beckmann(torch.zeros((), dtype=torch.float64), M).item() == pytest.approx(31.8309879, rel=1e-7)
    assert beckmann(torch.tensor(0.1, dtype=torch.float64).tan() ** 2, M).item() == pytest.approx(11.867091, rel=1e-5)


SMITH = {k: value for k, value in enumerate((0.998284, 0.986273, 0.950882, 0.859897, 0.625352), 14)}


@pytest.mark.parametrize(
    "angle, expected",
    [(0.98 * math.pi / 2, 0.673336), *((math.pi / 3 + math.pi / 6 * k / 19, value) for k, value in SMITH.items())],
)
def test_smith_has_the_published_values(angle: float, expected: float) -> None:
    assert (smith_over_cos(cos(angle), M) * cos(angle)).item() == pytest.approx(expected, abs=1e-5)


def test_schlick_of_glass() -> None:
    assert reflectance(1.5) == pytest.approx(0.04)
    assert schlick(torch.tensor(1.0), 0.04).item() == pytest.approx(0.04)
    assert schlick(torch.tensor(0.0), 0.04).item() == 1


@pytest.mark.parametrize(
    "cosine, f0, f90, expected",
    [
        (0.5, 0.04, 1.0, 0.04 + 0.96 / 32),  # (1 - 1/2)⁵ = 1/32
        (0.2, 0.04, 1.0, 0.04 + 0.96 * 0.32768),  # 0.8⁵ = 0.32768
        (0.75, 0.5, 1.0, 0.5 + 0.5 / 1024),  # (1/4)⁵ = 1/1024
        (0.5, 0.01, 0.25, 0.01 + 0.24 / 32),
    ],
)
def test_schlick_is_the_fifth_power_by_hand(cosine: float, f0: float, f90: float, expected: float) -> None:
    """Worked out here: tests that call `schlick` themselves cannot see that its exponent is wrong."""
    assert schlick(torch.tensor(cosine, dtype=torch.float64), f0, f90).item() == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("m", ROUGHNESS)
def test_facets_fill_the_surface(m: float) -> None:
    """∫ D cosθ dω = 1, over tan²θ: dω cosθ = π d(tan²) cos⁴."""
    tan2 = torch.linspace(0, 60 * m**2, 200_001, dtype=torch.float64)
    total = torch.trapezoid(beckmann(tan2, torch.tensor(m)) * math.pi / (1 + tan2) ** 2, tan2)
    assert total.item() == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("fresnel", ["eta", "albedo"])
@pytest.mark.parametrize("m", [0.02, 0.1, 0.3, 1.0])
def test_no_more_is_reflected_than_comes(fresnel: str, m: float) -> None:
    """The white furnace: with k_d + k_s = 1 no view returns more than 1. Quadrature over half vectors and cosines.

    The artists' base is dimmed by F of the view alone, the lobe by those of its facets, whose mean is more.
    """
    u, v = (
        x.flatten() for x in torch.meshgrid(*[(torch.arange(150, dtype=torch.float64) + 0.5) / 150] * 2, indexing="ij")
    )
    rough = torch.tensor(m, dtype=torch.float64)
    whites = ((0.0, 1.0), (0.5, 0.5), (0.96, 0.04), (1.0, 0.0), *([(1.0, 0.04)] if fresnel == "albedo" else []))
    for degrees in (0, 30, 55, 60, 80, 85, 89):
        o = view(degrees)
        for k_d, k_s in whites:
            model = Reflection(fresnel)  # pyright: ignore[reportArgumentType]
            scale = torch.tensor(k_s, dtype=torch.float64)
            i = torch.cat([reflect(o, sample_beckmann(u, v, rough)), sample_cosine(u, v)])
            density = (lobe_density(i, o.expand_as(i), rough) + cosine_density(i)) * len(u)
            base = model.base(torch.full((3,), k_d, dtype=torch.float64), scale, o[2])[0]
            value = base * cosine_density(i) + model.lobe(scale, rough, i, o.expand_as(i))
            total = (value / density.clamp(min=1e-12)).sum().item()
            assert total <= 1 + (2e-3 if k_d + k_s == 1 else 5e-3)
            assert fresnel == "eta" or k_s < 1 or m > 0.1 or degrees > 60 or total > 0.97


def test_a_white_lobe_of_glass_returns_four_percent() -> None:
    o, rough, one = view(0), torch.tensor(0.05, dtype=torch.float64), torch.ones((), dtype=torch.float64)
    i = hemisphere(1200)
    total = Reflection().lobe(one, rough, i, o.expand_as(i)).mean() * 2 * math.pi
    assert total.item() == pytest.approx(0.04, rel=2e-3)


@pytest.mark.parametrize("shadowing", ["smith", "cook-torrance"])
def test_light_and_eye_may_change_places(shadowing: str) -> None:
    u, v = squares(50, 1)
    i, o = sample_cosine(u, v), sample_cosine(v, u)
    model, m, k_s = Reflection(shadowing=shadowing), torch.full((50,), 0.3).double(), torch.ones(50).double()  # pyright: ignore[reportArgumentType]
    there, back = model.lobe(k_s, m, i, o) / i[:, 2], model.lobe(k_s, m, o, i) / o[:, 2]
    torch.testing.assert_close(there, back, rtol=1e-9, atol=0)


def test_grooves_by_hand() -> None:
    """i, o and h in one plane, 60° apart about a normal: 2 cosθh cosθo / (ωo·h) = 1/cos 30°·cos 60°·..."""
    value = cook_torrance_over_cos(*(torch.tensor(x, dtype=torch.float64) for x in (0.2, 0.9, 0.6, 0.7)))
    assert value.item() == pytest.approx((2 * 0.6 * 0.2 / 0.7) / (0.2 * 0.9))
    open_ = cook_torrance_over_cos(*(torch.tensor(x, dtype=torch.float64) for x in (0.9, 0.9, 1.0, 0.9)))
    assert open_.item() == pytest.approx(1 / 0.81)


@pytest.mark.parametrize("degrees", VIEWS)
@pytest.mark.parametrize("m", ROUGHNESS)
def test_the_lobe_is_sampled_with_its_density(m: float, degrees: float) -> None:
    """χ², in polar cells about the mirror direction; what falls elsewhere, or below the surface, is one cell more."""
    o, rough, n = view(degrees), torch.tensor(m, dtype=torch.float64), 60_000
    u, v = squares(n, int(1000 * m + degrees))
    i = reflect(o, sample_beckmann(u, v, rough))
    assert chi_squared(i, o, min(math.pi, 5 * m), lambda d: lobe_density(d, o.expand_as(d), rough)) > 0.01


def test_the_diffuse_lobe_is_sampled_with_its_density() -> None:
    assert chi_squared(sample_cosine(*squares(60_000, 3)), view(30), math.pi, cosine_density) > 0.01


def test_a_wrong_density_is_noticed() -> None:
    o, rough = view(45), torch.tensor(0.3, dtype=torch.float64)
    i = reflect(o, sample_beckmann(*squares(60_000, 4), rough))
    assert chi_squared(i, o, 1.5, lambda d: lobe_density(d, o.expand_as(d), rough * 1.03)) < 0.01


def chi_squared(i: Tensor, o: Tensor, reach: float, density) -> float:  # type: ignore[no-untyped-def]
    rings, sectors, fine = 10, 8, 24
    pole = torch.stack([-o[0], o[1], o[2]])
    side = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    frame = torch.stack([torch.linalg.cross(side, pole), side, pole])
    local = i @ frame.T
    alpha, beta = local[:, 2].clamp(-1, 1).acos(), torch.atan2(local[:, 1], local[:, 0]) % (2 * math.pi)
    cell = (alpha / reach * rings).long() * sectors + (beta / (2 * math.pi) * sectors).long().clamp(max=sectors - 1)
    lost = (alpha >= reach) | (i[:, 2] <= 0)
    observed = torch.bincount(torch.where(lost, rings * sectors, cell), minlength=rings * sectors + 1).double()
    a = (torch.arange(rings * fine, dtype=torch.float64) + 0.5) * reach / (rings * fine)
    b = (torch.arange(sectors * fine, dtype=torch.float64) + 0.5) * 2 * math.pi / (sectors * fine)
    around = torch.stack(
        torch.broadcast_tensors(a.sin()[:, None] * b.cos(), a.sin()[:, None] * b.sin(), a.cos()[:, None]), -1
    )
    mass = density(around @ frame) * a.sin()[:, None] * (reach / (rings * fine)) * (2 * math.pi / (sectors * fine))
    inside = mass.view(rings, fine, sectors, fine).sum((1, 3)).flatten()
    expected = torch.cat([inside, (1 - inside.sum()).clamp(min=0)[None]]) * len(i)
    keep = expected > 10  # the rest is one cell
    observed = torch.cat([observed[keep], observed[~keep].sum()[None]])
    expected = torch.cat([expected[keep], expected[~keep].sum()[None]])
    used = expected > 5
    statistic = ((observed - expected).square() / expected)[used].sum().item()
    return float(stats.chi2.sf(statistic, int(used.sum()) - 1))


def test_half_vectors_keep_their_digits_where_the_surface_is_smooth() -> None:
    """tan²θh of nearly parallel directions in float32, against float64."""
    tilt = torch.tensor([1e-4, 1e-3, 1e-2], dtype=torch.float64)
    i = torch.stack([tilt.sin(), torch.zeros(3), tilt.cos()], -1)
    o = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(3, 3)
    exact = tan_squared(half_vector(i, o)[0])
    single = tan_squared(half_vector(i.float(), o.float())[0])
    torch.testing.assert_close(single.double(), exact, rtol=1e-5, atol=0)


@pytest.mark.parametrize("options", [{"fresnel": "x"}, {"shadowing": "x"}, {"eta": 0.0}, {"eta": math.nan}])
def test_a_reflection_that_cannot_be_is_refused(options: dict[str, str]) -> None:
    with pytest.raises(UserError, match="give"):
        Reflection(**options)  # pyright: ignore[reportArgumentType]
