"""Distances by texture: closed forms, changes that must count and count more the larger they are, and faults."""

import math

import pytest
import torch
from scipy.stats import wasserstein_distance

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.patches import (
    kernel_patches,
    patch_distance,
    standardised,
    texture_features,
    wasserstein,
)

MEAN_OF_ABSOLUTE = math.sqrt(2 / math.pi)  # E|z| of a standard normal z


def noise(n, channels=1, size=16, seed=0, deviation=1.0):
    return torch.randn(n, channels, size, size, generator=generator_at(seed, 0, "noise")) * deviation


def texture(n, period, seed=0, size=32, channels=3):
    """Gaussian fields of unit deviation whose features are `period` texels wide."""
    frequency = torch.fft.fftfreq(size)
    radius = torch.hypot(frequency[:, None], frequency[None])
    band = torch.exp(-(((radius * period - 1) / 0.3) ** 2) / 2)
    x = torch.fft.ifft2(torch.fft.fft2(noise(n, channels, size, seed)) * band).real
    return x / x.std()


def blurred(x, deviation):
    frequency = torch.fft.fftfreq(x.shape[-1])
    gain = torch.exp(-2 * (math.pi * deviation) ** 2 * (frequency[:, None] ** 2 + frequency[None] ** 2))
    return torch.fft.ifft2(torch.fft.fft2(x) * gain).real


def test_wasserstein_of_sorted_rows_by_hand():
    # {0, 1} and {1, 2, 5}: quantiles 0 0 0 1 1 1 and 1 1 2 2 5 5 in sixths: (1 + 1 + 2 + 1 + 4 + 4) / 6.
    x, y = torch.tensor([[1.0, 0], [0, 0]]), torch.tensor([[2.0, 1, 5], [3, 3, 3]])
    assert wasserstein(x, y).tolist() == pytest.approx([13 / 6, 3])
    assert wasserstein(y, x).tolist() == pytest.approx([13 / 6, 3])


@pytest.mark.parametrize("m, n", [(20, 20), (21, 20), (7, 30)])
def test_wasserstein_is_scipys(m, n):
    x, y = noise(3 * m, size=1).view(3, m), noise(3 * n, size=1, seed=1).view(3, n) * 2
    expected = [wasserstein_distance(a, b) for a, b in zip(x.numpy(), y.numpy())]
    assert wasserstein(x, y).tolist() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("deviations", [(1.0, 0.5), (0.2, 0.3), (0.1, 0.1)])
def test_noise_of_known_deviations(deviations):
    """Every projection of white noise is normal of the same deviation: W1 = |σ₁ - σ₂| E|z|, here in units of σ₂."""
    first, second = deviations
    x, y = noise(400, 3, seed=1, deviation=first), noise(300, 3, seed=2, deviation=second)
    units = torch.tensor([1.0, 10, 100])[:, None, None]  # each channel is measured in its own deviation
    found = patch_distance(x * units, y * units, patches=16)
    assert list(found.levels) == [16] and found.mean == found.levels[16]
    assert found.mean == pytest.approx(abs(first - second) / second * MEAN_OF_ABSOLUTE, abs=0.04)


def test_a_shift_of_the_mean():
    # The sum of a random unit vector of 49 is about standard normal: W1 = shift E|z| / σ.
    x = noise(40, deviation=0.5)
    found = patch_distance(x + 0.3, x, projections=8192, patches=4)
    assert found.mean == pytest.approx(0.6 * MEAN_OF_ABSOLUTE, rel=0.03)


@pytest.mark.parametrize("size", [32, 35])
def test_a_set_is_at_no_distance_from_itself_in_any_order_and_number(size):
    x, order = noise(30, 3, size), torch.randperm(30, generator=generator_at(0))
    assert patch_distance(x, x, patches=9).mean == 0
    assert patch_distance(x[order], x, patches=9).mean < 1e-6
    assert patch_distance(torch.cat([x, x]), x, patches=9).mean < 1e-6
    assert kernel_patches(x[order], x) == pytest.approx(kernel_patches(x, x), abs=1e-5)
    y = noise(30, 3, size, seed=1) + 0.1
    once, again = (patch_distance(z, y, patches=9).mean for z in (x, x[order]))
    assert again == pytest.approx(once, rel=1e-4)


def test_the_seed_alone_decides():
    x, y = texture(20, 4), texture(20, 6, seed=1)
    found = [patch_distance(x, y, seed=seed, patches=9) for seed in (3, 3, 4)]
    assert found[0] == found[1] != found[2]


def change(x, kind, amount):
    if kind == "shift":
        return x + 0.2 * amount
    if kind == "contrast":
        return x * (1 + 0.2 * amount)
    if kind == "blur":
        return blurred(x, 0.4 * amount)
    return texture(len(x), 4 * (1 + 0.2 * amount), seed=1)


@pytest.mark.parametrize("kind", ["shift", "contrast", "blur", "scale"])
@pytest.mark.parametrize("distance", [lambda x, y: patch_distance(x, y, patches=8).mean, kernel_patches])
def test_larger_changes_are_further_away(kind, distance):
    truth, other = texture(80, 4), texture(80, 4, seed=1)
    found = [distance(change(other, kind, amount), truth) for amount in range(4)]
    assert found == sorted(found) and found[1] > found[0] + 0.02


def test_a_change_is_seen_at_its_own_level():
    x = texture(60, 3)
    levels = patch_distance(blurred(x, 0.7), x).levels
    assert levels[32] > 1.5 * levels[16]


@pytest.mark.parametrize("n", [20, 100])
def test_the_kernel_distance_of_two_samples_vanishes_as_they_grow(n):
    pairs = [(texture(n, 4, 2 * k, 16), texture(n, 4, 2 * k + 1, 16)) for k in range(5)]
    found = torch.tensor([kernel_patches(x, y) for x, y in pairs])
    assert found.abs().max() < 12 / n and found.mean().abs() < 6 / n


def test_features_know_directions_and_signs():
    wave = 0.5 + 0.1 * torch.sin(torch.arange(32) * 2 * math.pi / 8).expand(1, 1, 32, 32)
    colour, fine, coarse = texture_features(wave)
    assert colour.shape == (1, 2) and fine.shape == coarse.shape == (1, 20)
    assert colour[0].tolist() == pytest.approx([0.5, 0.1 / math.sqrt(2)], rel=0.01)
    across, diagonal, along, other = fine.view(4, 5)
    assert across.min() > 0.02 and along.max() < 1e-6
    assert (diagonal - other).abs().max() < 1e-3 and diagonal.max() < across.max()
    turned = texture_features(wave.mT)[1].view(4, 5)
    assert torch.allclose(turned[2], across, atol=1e-6)
    ridges = wave.clamp_min(0.5)
    up, down = (texture_features(x)[1].view(4, 5)[0] for x in (ridges, 1 - ridges))
    assert torch.allclose(up[[1, 0, 3, 2, 4]], down, atol=1e-6) and (up[2] - up[3]).abs() > 1e-3


def test_a_slanting_wave_answers_to_its_own_diagonal():
    place = torch.arange(32) * 2 * math.pi / 8
    wave = 0.1 * torch.sin(place[:, None] + place)[None, None]
    _, one, _, other = texture_features(wave)[1].view(4, 5)
    _, mirrored, _, answering = texture_features(wave.flip(3))[1].view(4, 5)
    assert one.min() > 0.025 and other.max() < 0.3 * one.min()
    assert answering.min() > 0.025 and mirrored.max() < 0.3 * answering.min()


def test_responses_of_a_wave_are_those_of_a_gaussians_derivatives():
    """G' has gain ω e^(-ω²/2) at frequency ω, G'' has ω² e^(-ω²/2); half of a wave's square is on each side of 0."""
    omega = 2 * math.pi / 16
    wave = torch.cos(omega * torch.arange(-0.5, 127)).expand(1, 1, 128, 128)
    first, _, second, _, energy = texture_features(wave)[1].view(4, 5)[0].tolist()
    gain = math.exp(-(omega**2) / 2)
    assert first == pytest.approx(omega * gain / 2, rel=0.03)
    assert second == pytest.approx(omega**2 * gain / 2, rel=0.03)
    assert energy > omega * gain * 2 / math.pi


def test_a_flat_image_has_no_texture():
    colour, octave = texture_features(torch.full((2, 3, 16, 16), 0.7))
    assert octave.abs().max() < 1e-5 and colour[:, :3].mean() == pytest.approx(0.7)


def test_groups_weigh_the_same():
    groups = [noise(50, 1, 1, seed)[:, :, 0, 0].repeat(1, d) for seed, d in ((0, 1), (1, 5), (2, 14))]
    x, y = standardised(groups, groups)
    assert x.shape == (50, 20) and torch.equal(x, y)
    z = torch.stack([(group[:, 0] - group[:, 0].mean()) / group[:, 0].std() for group in groups])
    assert torch.allclose((x[0] * x[1]).mean(), (z[:, 0] * z[:, 1]).mean().double(), atol=1e-5)


@pytest.mark.parametrize("distance", [patch_distance, kernel_patches])
def test_sets_that_cannot_be_compared(distance):
    x = noise(4)
    for bad, words in (
        (x[:1], "at least 2 of one size"),
        (noise(4, 3), "one size"),
        (noise(4, size=17), "one size"),
        (x[0], "one size"),
        (x * float("nan"), "NaN"),
    ):
        with pytest.raises(UserError, match=words) as error:
            distance(bad, x)
        assert "\n" not in str(error.value)
    with pytest.raises(UserError, match="16x16"):
        distance(noise(4, size=12), noise(4, size=12))
