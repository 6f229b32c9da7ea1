"""Correlations between maps: fields of known correlation, relief of known height, and maps that were shuffled."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.map_correlation import FIELDS, PAIRS, correlation_error, heights, map_correlations


def noise(n, size, seed):
    return torch.randn(n, size, size, generator=generator_at(seed, 0, "noise"))


def materials(diffuse, specular, roughness, height=None, seed=9):
    """(N, 8, H, W) of grey diffuse albedo and three more fields (N, H, W); height in texels, or any normals."""
    if height is None:
        slopes = 0.3 * torch.stack([noise(len(diffuse), diffuse.shape[-1], seed + k) for k in range(2)], 1)
    else:
        rows, columns = torch.gradient(height, dim=(1, 2))
        slopes = torch.stack([-columns, rows], 1)  # y is up, rows go down
    normal = normalize(torch.cat([slopes, torch.ones_like(slopes[:, :1])], 1), dim=1)
    return torch.cat([diffuse[:, None].expand(-1, 3, -1, -1), specular[:, None], roughness[:, None], normal], 1)


def smooth(n, size, seed, period=8.0):
    """Fields whose waves are all of that period or longer."""
    frequency = torch.fft.fftfreq(size)
    low = torch.hypot(frequency[:, None], frequency[None]) <= 1 / period
    x = torch.fft.ifft2(torch.fft.fft2(noise(n, size, seed)) * low).real
    return x / x.std()


def linked(n=150, size=32):
    """All four maps go with one field, with different strength."""
    common = smooth(n, size, 0)
    fields = [common + k / 2 * smooth(n, size, k) for k in (1, 2, 3)]
    return materials(fields[0], -fields[1], fields[2], common)


def test_fields_of_known_correlation():
    a, b, c = (noise(3000, 16, seed) for seed in range(3))
    x = materials(a, 0.6 * a + 0.8 * b, 3 * (0.5 - 0.3 * a + math.sqrt(1 - 0.09) * c))
    table = map_correlations(x)
    assert table.scales == ("16", "8", "mean") and table.values.shape == (3, 6)
    expected = {("diffuse", "specular"): 0.6, ("diffuse", "roughness"): -0.3, ("specular", "roughness"): -0.18}
    for scale in table.values:
        for pair, value in zip(PAIRS, scale.tolist()):
            assert value == pytest.approx(expected.get(pair, 0), abs=0.03)


def test_a_coloured_specular_albedo_counts_by_its_luminance():
    """Noise whose luminance is 0 is not seen, that of green is."""
    a, b = noise(200, 16, 0), noise(200, 16, 1)
    x = materials(a, a, b)
    swing = b[:, None] * torch.tensor([0.7152, -0.2126, 0.0])[:, None, None]
    three = torch.cat([x[:, :3], x[:, 3:4] + swing, x[:, 4:]], 1)
    table = map_correlations(three)
    torch.testing.assert_close(table.values, map_correlations(x).values, atol=1e-4, rtol=0)
    three[:, 4] = b
    assert map_correlations(three).values[0, PAIRS.index(("specular", "roughness"))] > 0.5


def test_scales_are_told_apart():
    """Two maps that agree in what is coarse and are opposite in what is fine."""
    fine, coarse = noise(50, 64, 0), smooth(50, 64, 1, period=24)
    x = materials(fine + 3 * coarse, 3 * coarse - fine, noise(50, 64, 2))
    values = map_correlations(x).values[:, PAIRS.index(("diffuse", "specular"))]
    assert values[0] < -0.9 and values[3] > 0.9


def test_the_relief_is_the_height_of_the_normals():
    """+1 if hills are light, for slopes in every direction: the signs of x and y are the conventions'."""
    height = smooth(20, 64, 0, period=12)
    table = map_correlations(materials(height, -height, noise(20, 64, 1), height))
    by_pair = dict(zip(PAIRS, table.values[1:4].T))
    assert by_pair["diffuse", "normal"].min() > 0.97 and by_pair["specular", "normal"].max() < -0.97
    assert by_pair["roughness", "normal"].abs().max() < 0.1


def test_a_material_turned_upside_down_by_its_normals_is_another():
    height = smooth(20, 32, 0, period=12)
    x = materials(height, height, height, height)
    x[:, 6] *= -1
    assert map_correlations(x).values[1, PAIRS.index(("diffuse", "normal"))] < 0.6


@pytest.mark.parametrize("height, width", [(32, 32), (20, 33)])
def test_heights_fit_slopes(height, width):
    """Neighbours that differ by the mean of their slopes: found again but for the mean."""
    u, v = torch.arange(height).float()[:, None], torch.arange(width).float()[None]
    wanted = 0.02 * (u - 3) ** 2 - 0.01 * (v - 9) ** 2 + 0.3 * u
    slopes = torch.stack([(-0.02 * (v - 9)).expand(height, -1), (0.04 * (u - 3) + 0.3).expand(-1, width)])
    found = heights(slopes[None])[0, 0]
    assert (found - (wanted - wanted.mean())).abs().max() < 1e-3
    assert heights(torch.zeros(2, 2, height, width)).abs().max() == 0


def test_steeper_goes_with_rougher_at_the_mean():
    amplitude = torch.linspace(0.1, 1, 100)[:, None, None]
    x = materials(noise(100, 16, 0), noise(100, 16, 1), amplitude.expand(-1, 16, 16), amplitude * smooth(100, 16, 2))
    assert map_correlations(x).values[-1, PAIRS.index(("roughness", "normal"))] > 0.8


def test_constant_maps_correlate_with_nothing():
    x = materials(noise(10, 16, 0), noise(10, 16, 1), torch.full((10, 16, 16), 0.3))
    x[:, 5:] = torch.tensor([0.6, 0, 0.8])[:, None, None]
    values = map_correlations(x).values
    for index, pair in enumerate(PAIRS):
        flat = "roughness" in pair or "normal" in pair
        assert values[:, index].abs().max() == 0 if flat else values[:, index].abs().max() > 0
    assert map_correlations(torch.full((3, 8, 16, 16), 0.5)).values.abs().max() == 0


def test_neither_offset_nor_contrast_matters():
    x = linked(40)
    y = x.clone()
    y[:, :3], y[:, 3], y[:, 4] = x[:, :3] * 0.1 + 5, x[:, 3] * 7, x[:, 4] + 1
    assert torch.allclose(map_correlations(x).values, map_correlations(y).values, atol=1e-3)


def test_a_set_against_itself_in_any_order():
    x, order = linked(40), torch.randperm(40, generator=generator_at(0))
    assert correlation_error(x, x).overall == 0
    assert correlation_error(x[order], x).overall < 1e-5


@pytest.mark.parametrize("channels, field", [((0, 1, 2), "diffuse"), ((4,), "roughness"), ((5, 6, 7), "normal")])
def test_a_shuffled_map_loses_its_correlations_and_no_other(channels, field):
    truth = linked(400)
    shuffled = truth.clone()
    shuffled[:, channels] = truth[torch.randperm(400, generator=generator_at(1))][:, channels]
    error = correlation_error(shuffled, truth)
    mine = torch.tensor([field in pair for pair in PAIRS])
    lost = error.truth.values * mine
    assert lost.square().mean().sqrt() > 0.2
    assert error.overall == pytest.approx(lost.square().mean().sqrt().item(), rel=0.1)
    assert error.generated.values[:-1, mine].abs().max() < 0.1  # but for "mean", of 400 values alone
    by_pair = error.by_pair()
    assert all(by_pair[pair] < 1e-6 for pair in PAIRS if field not in pair)
    by_scale = list(error.by_scale().values())
    assert error.overall**2 == pytest.approx(sum(value**2 for value in by_scale) / len(by_scale))
    assert tuple(error.by_scale()) == error.truth.scales == ("32", "16", "8", "mean")


def test_the_error_grows_with_the_share_that_was_shuffled():
    truth, found = linked(100), []
    for share in (0, 20, 50, 100):
        x = truth.clone()
        x[:share, 4] = truth[:share, 4].roll(1, 0)
        found.append(correlation_error(x, truth).overall)
    assert found[0] == 0 and found == sorted(found) and found[1] > 0.02


def test_names():
    assert FIELDS == ("diffuse", "specular", "roughness", "normal") and len(PAIRS) == 6


def test_materials_that_cannot_be_compared():
    x = linked(4, 16)
    for bad, words in (
        (x[:1], "at least 2"),
        (x[:, :7], "of one size"),
        (linked(4, 17), "of one size"),
        (x * float("nan"), "NaN"),
    ):
        with pytest.raises(UserError, match=words) as error:
            correlation_error(bad, x)
        assert "\n" not in str(error.value)
    with pytest.raises(UserError, match=r"\(B, 8, H, W\)"):
        map_correlations(x[:, :7])
    with pytest.raises(UserError, match="at least 2 materials"):
        map_correlations(x[:1])
