"""Statistics of bands: what goes together in an image is found, at its octave, and nothing else."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject.data import correlated
from unproject.ops.band_statistics import Covariance, band_statistics, opponent
from unproject.ops.maps import MAPS
from unproject.ops.microfacet import Reflection
from unproject.projections import Rendering


def noise(n: int, channels: int, size: int = 32, seed: int = 0) -> Tensor:
    return torch.randn(n, channels, size, size, generator=generator_at(seed))


def number_of(channels: int, levels: int) -> int:
    """Means, then of each level log variances and correlations of 4 C + 1 fields, and those across levels."""
    fields = 4 * channels + 1
    return channels + levels * fields * (fields + 1) // 2 + (levels - 1) * (channels + 1) * (2 * channels + 1)


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_they_are_finite_and_differentiable_and_each_image_has_its_own(channels: int) -> None:
    x = noise(3, channels).double().requires_grad_()
    s = band_statistics(x)
    assert s.shape == (3, number_of(channels, 3)) and bool(s.isfinite().all())
    torch.testing.assert_close(band_statistics(x[1:2]), s[1:2])
    assert torch.autograd.gradcheck(band_statistics, noise(1, channels, 8).double().requires_grad_())


def test_flat_images_have_statistics_and_gradients() -> None:
    x = torch.full((2, 3, 16, 16), 0.4, requires_grad=True)
    s = band_statistics(x)
    s.sum().backward()
    assert bool(s.isfinite().all()) and x.grad is not None and bool(x.grad.isfinite().all())


def test_covariances_are_those_of_the_plain_formula_forwards_and_back() -> None:
    fields = noise(2, 5, 6).flatten(2).double().requires_grad_()
    pull = torch.randn(2, 5, 5, generator=generator_at(1)).double()  # not symmetric
    centred = fields - fields.mean(2, keepdim=True)
    plain = centred @ centred.mT / 36
    fast = Covariance.apply(fields)
    torch.testing.assert_close(fast, plain)
    assert torch.autograd.grad(fast, fields, pull)[0].allclose(torch.autograd.grad(plain, fields, pull)[0])


def first_correlations(x: Tensor) -> Tensor:
    """Return the correlations of the finest level's fields, (B, F, F)."""
    fields = 4 * x.shape[1] + 1
    within = band_statistics(x)[:, x.shape[1] : x.shape[1] + fields * (fields + 1) // 2][:, fields:]
    table = torch.zeros(len(x), fields, fields)
    i, j = torch.triu_indices(fields, fields, 1)
    table[:, i, j] = within
    return table


def test_correlations_of_channels_are_those_of_their_bands() -> None:
    """Of two channels a, ρ a + √(1 - ρ²) b the bands have correlation ρ; slopes have that of their own channel."""
    a, b = noise(40, 2).chunk(2, 1)
    for rho in (0.0, 0.6, -1.0):
        found = first_correlations(torch.cat([a, rho * a + math.sqrt(1 - rho**2) * b], 1)).mean(0)
        for i, j in ((0, 1), (2, 3), (4, 5)):  # bands, slopes along x, slopes along y
            assert found[i, j].item() == pytest.approx(rho, abs=0.03)
        assert (
            abs(found[0, 2]) > 0.4 and abs(found[0, 5] - rho * found[1, 5]) < 0.05
        )  # a forward difference is not centred


def test_energies_that_go_together_are_found_where_bands_do_not() -> None:
    """A contrast that two channels share shows in the correlation of their squares alone."""
    contrast = torch.nn.functional.interpolate(noise(40, 1, 4, seed=3).exp(), (32, 32))
    shared = first_correlations(noise(40, 2) * contrast).mean(0)
    alone = first_correlations(noise(40, 2)).mean(0)
    assert abs(shared[0, 1]) < 0.05 and shared[6, 7] > alone[6, 7] + 0.1


def test_slopes_have_their_own_axis() -> None:
    """Stripes that run along x, and along y: the logarithm of the variance of ∂_x b, and of ∂_y b."""
    along_x = noise(2, 1)[:, :, :, :1].expand(-1, -1, -1, 32)
    for image, slope in ((along_x, 2), (along_x.mT, 1)):
        variances = band_statistics(image)[:, 1:][:, :5]
        assert (variances[:, slope] - variances[:, 3 - slope]).min() > 5


def test_colours_are_opponent() -> None:
    grey = noise(2, 1).expand(-1, 3, -1, -1)
    assert opponent(grey)[:, 1:].abs().max() < 1e-6
    torch.testing.assert_close(opponent(grey)[:, :1], grey[:, :1])
    assert opponent(noise(1, 2)).shape[1] == 2


def z_squared(x: Tensor, y: Tensor) -> float:
    """Return the mean square of the difference of the means of statistics, in units of its standard error."""
    s, t = (band_statistics(pictures) for pictures in (x, y))
    return ((s.mean(0) - t.mean(0)).square() / (s.var(0) / len(s) + t.var(0) / len(t) + 1e-9)).mean().item()


def test_photographs_tell_whose_relief_it_is() -> None:
    """Coloured lamps at 60°: with relief exchanged between materials statistics differ; of two draws they do not."""
    truth, others = correlated(80, 32, 0), correlated(80, 32, 1)
    exchanged = others.clone()
    exchanged[:, MAPS["normal"]] = others[:, MAPS["normal"]].roll(1, 0)
    coloured = Rendering("coloured", Reflection("albedo"))
    angle = torch.zeros(80)
    seen = [
        coloured(maps, view=angle, light=angle + math.radians(60), light_azimuth=angle + math.pi)
        for maps in (truth, others, exchanged)
    ]
    alike, different = z_squared(seen[0], seen[1]), z_squared(seen[0], seen[2])
    assert alike < 1.5 and different > 4 * alike, (alike, different)
