"""The estimator: its mean against quadrature, its gradients against differences and quadrature, its noise."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.ops import shading
from unproject.ops.environment import look_up, prepare_environments
from unproject.ops.lights import Ambient, Directional, Environment, Light
from unproject.ops.maps import MAPS
from unproject.ops.microfacet import Reflection
from unproject.ops.plane import to_camera, towards
from unproject.ops.shading import Sampling, pixels_of, reflected, shade
from unproject.ops.shading_native import can_shade, shade_fast

MODELS = [Reflection(), Reflection("albedo"), Reflection(shadowing="cook-torrance"), Reflection("eta", 2.5)]
GRADIENTS = pytest.mark.parametrize("gradient", ["exact", "fixed", "differences"])


def maps(batch: int, size: int, seed: int = 0, tilt: float = 0.4, roughest: float = 0.9) -> Tensor:
    x = torch.rand(batch, 8, size, size, generator=generator_at(seed), dtype=torch.float64)
    x[:, 4] = 0.15 + (roughest - 0.15) * x[:, 4]
    normal = torch.cat([tilt * (2 * x[:, 5:7] - 1), torch.ones_like(x[:, :1])], 1)
    x[:, 5:] = normal / normal.norm(dim=1, keepdim=True)
    return x


def camera(batch: int, size: int) -> Tensor:
    """At normal and grazing views in turn."""
    theta = torch.tensor([0.05, 1.39, 0.8])[torch.arange(batch) % 3].double()
    return to_camera(theta, torch.full_like(theta, -1.4), 4.0, size, size)


def natural(batch: int, sun: float = 0.0) -> Environment:
    light = torch.rand(2, 3, 6, 12, generator=generator_at(9), dtype=torch.float64)
    light = torch.nn.functional.interpolate(light, size=(16, 32), mode="bilinear")
    light[:, :, 4, 7] += sun
    which = torch.arange(batch) % 2
    return Environment(prepare_environments(light), which, which.double() + 0.3)


def jitter(batch: int, seed: int = 0) -> Tensor:
    return torch.rand(batch, generator=generator_at(seed), dtype=torch.float64)


def quadrature(x: Tensor, toward: Tensor, light: Light, model: Reflection, n: int = 400) -> Tensor:
    """(3,) of one pixel: the integral over a fine grid of the sphere."""
    t = (torch.arange(n, dtype=torch.float64) + 0.5) * math.pi / n
    p = (torch.arange(2 * n, dtype=torch.float64) + 0.5) * math.pi / n
    theta, phi = (a.flatten() for a in torch.meshgrid(t, p, indexing="ij"))
    d, weight = towards(theta, phi)[None, None], theta.sin() * (math.pi / n) ** 2
    pixels = pixels_of(x, toward)
    value = reflected(pixels, pixels.local(d), model)[0, 0]
    if isinstance(light, Environment):
        value = value * look_up(*light[:1], light.which, light.turn, d[:, 0])[0][0]
    return (value * weight[:, None]).sum(0)


@pytest.mark.parametrize("model", MODELS, ids=str)
@pytest.mark.parametrize("kind", ["ambient", "natural", "sun"])
def test_the_mean_is_the_integral(kind: str, model: Reflection) -> None:
    x, toward = maps(3, 1), camera(3, 1)
    light = Ambient() if kind == "ambient" else natural(3, 200.0 if kind == "sun" else 0.0)
    seen = shade(x, toward, light, model, Sampling(4096), jitter(3))
    for b in range(3):
        alone = (
            light
            if isinstance(light, Ambient)
            else Environment(light.environments, light.which[b : b + 1], light.turn[b : b + 1])
        )
        expected = quadrature(x[b : b + 1], toward[b : b + 1], alone, model)
        torch.testing.assert_close(seen[b, :, 0, 0], expected, rtol=0.01, atol=0)


@pytest.mark.parametrize("points", ["low-discrepancy", "independent"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_no_share_and_no_kind_of_points_changes_the_mean(share: float, points: str) -> None:
    x, toward, light = maps(1, 1).expand(400, -1, -1, -1), camera(1, 1).expand(400, -1, -1, -1), natural(1, 20.0)
    many = Environment(light.environments, light.which.expand(400), light.turn.expand(400))
    seen = shade(x, toward, many, Reflection(), Sampling(16, share, points), jitter(400))[:, 0, 0, 0]  # pyright: ignore[reportArgumentType]
    expected = quadrature(x[:1], toward[:1], light, Reflection())[0]
    assert abs(seen.mean() - expected) < 4 * seen.std() / 20


def test_white_and_matt_under_each_light() -> None:
    """A directional light has irradiance π on what faces it, ambient radiance is 1: white paper is 1 under either."""
    x = torch.zeros(1, 8, 2, 2, dtype=torch.float64)
    x[:, :3], x[:, 4], x[:, 7] = 1, 0.5, 1
    straight = Directional(torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64))
    oblique = Directional(towards(*torch.tensor([[math.pi / 3], [0.4]], dtype=torch.float64)))
    one = torch.ones(1, 3, 2, 2, dtype=torch.float64)
    for light, expected in ((straight, one), (oblique, one / 2), (Ambient(), one)):
        seen = shade(x, camera(1, 2), light, Reflection(), Sampling(64), jitter(1))
        torch.testing.assert_close(seen, expected, rtol=2e-3, atol=0)


@pytest.mark.parametrize("look", [shade, shade_fast], ids=["reference", "kernel"])
@pytest.mark.parametrize(
    "model, k_d, k_s, expected",
    [
        (Reflection(), 0.0, 1.0, 0.04 + 0.96 / 32),
        (Reflection("eta", 3.0), 0.0, 0.5, 0.5 * (0.25 + 0.75 / 32)),
        (Reflection("albedo"), 0.0, 0.2, 0.2 + 0.8 / 32),
        (Reflection("albedo"), 0.5, 0.2, 0.225 + 0.5 * (1 - 0.225)),
        (Reflection("albedo"), 0.0, 0.01, 0.01 + (0.01 / 0.04 - 0.01) / 32),  # F90 = k_s / 0.04 below 0.04
        (Reflection("albedo"), 0.5, 0.0, 0.5),
    ],
    ids=str,
)
def test_a_smooth_surface_at_60_degrees_mirrors_schlicks_share_of_a_white_sky(
    model: Reflection, k_d: float, k_s: float, expected: float, look: Callable[..., Tensor]
) -> None:
    """Where m is next to 0, F = F0 + (F90 - F0) (1 - cos 60°)⁵ by hand, of both implementations, comes back."""
    x = torch.zeros(1, 8, 3, 3)
    x[:, :3], x[:, 3], x[:, 4], x[:, 7] = k_d, k_s, 0.02, 1
    toward = towards(torch.tensor([math.pi / 3]), torch.tensor([0.4]))[:, :, None, None].expand(1, 3, 3, 3)
    if look is shade_fast and not can_shade(x, toward, Ambient(), model):
        pytest.skip("no compiler")
    seen = look(x, toward.contiguous(), Ambient(), model, Sampling(512), torch.tensor([0.5]))
    torch.testing.assert_close(seen, torch.full_like(seen, expected), rtol=0.02, atol=1e-4)


@pytest.mark.parametrize("kind", ["directional", "ambient", "natural"])
@pytest.mark.parametrize("model", MODELS[:2], ids=str)
def test_exact_gradients_are_the_slopes_of_the_estimate(kind: str, model: Reflection) -> None:
    """Relative error below 1e-3 of central differences with common random numbers, each map, normal and grazing."""
    x, toward, weight = maps(2, 3), camera(2, 3), jitter(2 * 27, 5).view(2, 3, 3, 3)
    light = {"ambient": Ambient(), "natural": natural(2, 5.0)}.get(kind) or Directional(
        towards(torch.tensor([0.5, 1.2], dtype=torch.float64), torch.tensor([0.3, 2.0], dtype=torch.float64))
    )

    def seen(x: Tensor) -> Tensor:
        return (shade(x, toward, light, model, Sampling(24), jitter(2)) * weight).sum()

    x.requires_grad_()
    (slope,) = torch.autograd.grad(seen(x), x)
    for name, place in MAPS.items():
        along = torch.zeros_like(x)
        along[:, place] = torch.randn(x[:, place].shape, generator=generator_at(7), dtype=x.dtype)
        with torch.no_grad():
            difference = (seen(x + 1e-6 * along) - seen(x - 1e-6 * along)) / 2e-6
        assert abs((slope * along).sum() / difference - 1) < 1e-3, name


@GRADIENTS
@pytest.mark.parametrize("b", [0, 1])
def test_each_gradient_is_that_of_the_integral(b: int, gradient: str) -> None:
    """Its mean over many seeds is, within 4.5 standard errors of that mean."""
    x, toward, light = maps(2, 1, 3)[b : b + 1], camera(2, 1)[b : b + 1], natural(2)
    alone, seeds, model = (
        Environment(light.environments, light.which[b : b + 1], light.turn[b : b + 1]),
        100,
        Reflection("albedo"),
    )
    leaf = x.clone().requires_grad_()
    (exact,) = torch.autograd.grad(quadrature(leaf, toward, alone, model).sum(), leaf)
    many = x.repeat(seeds, 1, 1, 1).requires_grad_()
    lit = Environment(light.environments, alone.which.repeat(seeds), alone.turn.repeat(seeds))
    options = Sampling(256, gradient=gradient)  # pyright: ignore[reportArgumentType]
    seen = shade(many, toward.expand(seeds, -1, -1, -1), lit, model, options, jitter(seeds))
    (slopes,) = torch.autograd.grad(seen.sum(), many)
    error = slopes.std(0) / seeds**0.5
    assert ((slopes.mean(0) - exact[0]).abs() <= 4.5 * error + 1e-3 * exact.abs().max()).all()
    assert (error[:4].amax() < 0.02 * exact[0, :4].amax()).all()  # and that says something


@pytest.mark.parametrize("length", [1.0, 2.0])
def test_differences_are_the_fixed_gradient(length: float) -> None:
    """The same samples on both sides: only the second order of a step of 0.001 is left; for normals of any length."""
    x, toward, light = maps(3, 2, 4), camera(3, 2), natural(3, 5.0)
    x[:, 5:] *= length
    found = []
    for gradient in ("fixed", "differences"):
        leaf = x.clone().requires_grad_()
        seen = shade(leaf, toward, light, Reflection(), Sampling(32, gradient=gradient), jitter(3))  # pyright: ignore[reportArgumentType]
        found.append(torch.autograd.grad(seen.sum(), leaf)[0])
    torch.testing.assert_close(found[1], found[0], rtol=1e-3, atol=1e-3 * found[0].abs().mean().item())


def test_differences_of_tilted_normals_are_no_larger_than_the_fixed_gradient() -> None:
    """Samples just below the horizon have no density: lifted above it they must not weigh 1 / 0."""
    rng = generator_at(3)
    x = torch.rand(1, 8, 16, 16, generator=rng, dtype=torch.float64)
    x[:, 5:] = torch.nn.functional.normalize(x[:, 5:] - torch.tensor([0.5, 0.5, 0.0]).view(1, 3, 1, 1), dim=1)
    largest = {}
    for gradient in ("fixed", "differences"):
        leaf = x.clone().requires_grad_()
        shade(leaf, camera(1, 16), Ambient(), Reflection(), Sampling(16, gradient=gradient), jitter(1)).sum().backward()  # pyright: ignore[reportArgumentType]
        assert leaf.grad is not None
        largest[gradient] = leaf.grad[:, 5:].abs().max().item()
    assert largest["differences"] == pytest.approx(largest["fixed"], rel=0.2)


@GRADIENTS
@pytest.mark.parametrize("native", [False, True])
def test_nothing_is_ever_nan(gradient: str, native: bool) -> None:
    """Roughness from 0.001 to 1, normals up to 80° off, black and white albedos, from above and at 89°."""
    x = torch.zeros(2, 8, 4, 6)
    x[:, :4] = torch.tensor([0.0, 1.0, 0.0, 1.0]).view(1, 1, 4, 1)
    x[:, 4] = torch.tensor([1e-3, 3e-3, 0.03, 0.2, 0.6, 1.0])
    tilt = torch.tensor([0.0, 0.5, 1.0, math.radians(80)])[:, None].expand(4, 6)
    x[:, 5], x[:, 7] = tilt.sin(), tilt.cos()
    theta = torch.tensor([0.0, math.radians(89)])
    toward = to_camera(theta, torch.full_like(theta, 2.0), 4.0, 4, 6)
    light = natural(2, 1e4)
    bright = Environment(
        prepare_environments(light.environments.table[..., :3].permute(0, 3, 1, 2).float()),
        light.which,
        light.turn.float(),
    )
    for lit in (bright, Ambient(), Directional(towards(theta, theta))):
        for model in MODELS[:3]:
            leaf = x.clone().requires_grad_()
            options = Sampling(16, gradient=gradient)  # pyright: ignore[reportArgumentType]
            seen = (shade_fast if native else shade)(leaf, toward, lit, model, options, torch.tensor([0.1, 0.2]))
            (slope,) = torch.autograd.grad(seen.sum(), leaf)
            assert seen.isfinite().all() and slope.isfinite().all()
            assert seen.min() >= 0


@pytest.mark.parametrize("points", ["low-discrepancy", "independent"])
@pytest.mark.parametrize("model", MODELS[:2], ids=str)
@pytest.mark.parametrize("gradient", ["exact", "fixed"])
def test_the_kernel_is_the_reference(gradient: str, model: Reflection, points: str) -> None:
    x, toward = maps(3, 5).float(), camera(3, 5).float()  # 25 pixels: not a multiple of 8
    if not can_shade(x, toward, Ambient(), model):
        pytest.skip("no compiler")
    double = natural(3, 50.0)
    ready = prepare_environments(double.environments.table[..., :3].permute(0, 3, 1, 2).float())
    weight = torch.rand(3, 3, 5, 5, generator=generator_at(2))
    for light in (Environment(ready, double.which, double.turn.float()), Ambient()):
        found = []
        for estimate in (shade, shade_fast):
            leaf = x.clone().requires_grad_()
            options = Sampling(32, points=points, gradient=gradient)  # pyright: ignore[reportArgumentType]
            seen = estimate(leaf, toward, light, model, options, torch.tensor([0.2, 0.5, 0.9]))
            found.append((seen.detach(), torch.autograd.grad(seen, leaf, weight)[0]))
        (a, da), (b, db) = found
        assert (a - b).norm() < 1e-4 * a.norm()
        for place in MAPS.values():
            # Half a texel more or less is another slope of the environment: a few samples differ by rounding.
            assert (da[:, place] - db[:, place]).norm() < 1e-2 * da[:, place].norm()


@pytest.mark.parametrize("spoil", [(4, math.nan), (5, math.nan), (0, math.nan)])
def test_what_has_broken_down_shows(spoil: tuple[int, float]) -> None:
    """A NaN in a map is a NaN in its texel, by the kernel too, and nowhere else."""
    x = maps(1, 4).float()
    x[0, spoil[0], 1, 2] = spoil[1]
    for estimate in (shade, shade_fast):
        seen = estimate(x, camera(1, 4).float(), Ambient(), Reflection(), Sampling(8), torch.tensor([0.5]))
        assert seen.isnan().any(1)[0].nonzero().tolist() == [[1, 2]]


def test_a_light_that_is_turned_far_or_learned() -> None:
    """The kernel stays inside its table, and leaves slopes of the light to the reference."""
    x, toward = maps(1, 4).float(), camera(1, 4).float()
    probe = torch.rand(1, 3, 15, 30, generator=generator_at(8)) + 0.1
    for turn in (1e9, -1e20, math.nan):
        light = Environment(prepare_environments(probe), torch.zeros(1, dtype=torch.long), torch.tensor([turn]))
        shade_fast(x, toward, light, Reflection(), Sampling(8), torch.tensor([0.5]))
    turn = torch.tensor([0.3], requires_grad=True)
    light = Environment(prepare_environments(probe), torch.zeros(1, dtype=torch.long), turn)
    (slope,) = torch.autograd.grad(
        shade_fast(x, toward, light, Reflection(), Sampling(8), torch.tensor([0.5])).sum(), turn
    )
    assert slope.abs() > 0


def test_more_than_everything_is_reflected_and_nothing_is_negative() -> None:
    x = maps(2, 4).float()
    x[:, 3] = 3
    for estimate in (shade, shade_fast):
        leaf = x.clone().requires_grad_()
        seen = estimate(
            leaf, camera(2, 4).float(), Ambient(), Reflection("albedo"), Sampling(8), torch.tensor([0.5, 0.2])
        )
        (slope,) = torch.autograd.grad(seen.sum(), leaf)
        assert seen.min() >= 0 and slope.isfinite().all()


def test_the_seeds_differences_survive_a_roughness_of_nothing() -> None:
    x = maps(1, 4)
    x[:, 4] = torch.tensor([0.0, 1e-12, 1e-3, 0.2])
    x.requires_grad_()
    seen = shade(x, camera(1, 4), Ambient(), Reflection(), Sampling(8, gradient="differences"), jitter(1))
    (slope,) = torch.autograd.grad(seen.sum(), x)
    assert slope.isfinite().all() and not slope[:, 4, :, :2].any()


def test_noise_under_a_sun_is_a_third_of_uniform_sampling_at_most() -> None:
    """32 samples, the variance over seeds, against uniform directions of the hemisphere about the normal."""
    repeats, ready = 1500, natural(1, 300.0)
    light = Environment(ready.environments, ready.which.expand(repeats), ready.turn.expand(repeats))
    for roughness in (0.1, 0.5):
        for theta in (0.1, 1.2):
            x = torch.zeros(1, 8, 1, 1, dtype=torch.float64)
            x[:, :3], x[:, 3], x[:, 4], x[:, 7] = 0.4, 0.5, roughness, 1
            toward = to_camera(torch.tensor([theta]).double(), torch.tensor([-1.0]).double(), 4.0, 1, 1)
            many, far = x.expand(repeats, -1, -1, -1), toward.expand(repeats, -1, -1, -1)
            ours = shade(many, far, light, Reflection("albedo"), Sampling(32), jitter(repeats))[:, 0, 0, 0]
            u = torch.rand(repeats, 32, 2, generator=generator_at(3), dtype=torch.float64)
            d = towards(u[..., 0].acos(), 2 * math.pi * u[..., 1])
            value = reflected(pixels_of(many, far), d[:, None], Reflection("albedo"))[:, 0]
            value = value * look_up(light.environments, light.which, light.turn, d)[0]
            uniform = (value * 2 * math.pi).mean(1)[:, 0]
            assert ours.mean() == pytest.approx(uniform.mean().item(), abs=5 * uniform.std().item() / repeats**0.5)
            assert ours.var() < uniform.var() / 3


def test_memory_does_not_grow_with_the_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """The largest tensor kept for the gradient is as large for 8 samples as for 64."""
    monkeypatch.setattr(shading, "CHUNK", 4 * 16)
    sizes = []
    for samples in (8, 64):
        kept: list[int] = []
        with torch.autograd.graph.saved_tensors_hooks(lambda t, kept=kept: kept.append(t.numel()) or t, lambda t: t):
            shade(
                maps(1, 4).requires_grad_(), camera(1, 4), natural(1), Reflection(), Sampling(samples, 0.0), jitter(1)
            )
        sizes.append(max(kept))
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize(
    "options",
    [
        {"samples": 1},
        {"samples": 2**40},
        {"samples": 2.5},
        {"light": 1.0},
        {"light": -0.1},
        {"points": "x"},
        {"gradient": "x"},
    ],
    ids=str,
)
def test_sampling_that_cannot_be_is_refused(options: dict[str, object]) -> None:
    with pytest.raises(UserError, match="give"):
        Sampling(**options)  # pyright: ignore[reportArgumentType]
