"""Scores of images: what the classifier knows, known answers, and the gauge."""

import pytest
import torch

from unproject._types import UserError
from unproject.data import birds, digit_labels, digits
from unproject.metrics import Gauge, apply_to_images, are_digits, best_image_gauge, image_scores, pixel_scores
from unproject.metrics.digit_classifier import digit_features
from unproject.projections.line_integral import LineIntegral

DIGITS = digits(32, held_out=True)


def test_the_classifier_knows_digits_it_never_saw():
    features, found = digit_features(DIGITS)
    assert features.shape == (297, 64)
    assert (found == digit_labels(held_out=True)).double().mean() > 0.97
    assert (digit_features(digits(16, held_out=True))[1] == found).double().mean() > 0.9


def test_what_is_stored_says_how_good_it_is():
    from importlib.resources import files

    from safetensors import safe_open

    path = files("unproject.metrics") / "digit_classifier.safetensors"
    assert len(path.read_bytes()) < 1_000_000
    with safe_open(str(path), "pt") as stored:
        about = stored.metadata()
    right = (digit_features(DIGITS)[1] == digit_labels(held_out=True)).double().mean().item()
    assert float(about["accuracy_mnist"]) > 0.99
    assert float(about["accuracy_embedded"]) == pytest.approx(right, abs=1 / 297)


def test_a_set_against_itself():
    scores = {name: score.value for name, score in image_scores(DIGITS, DIGITS).items()}
    assert abs(scores["frechet"]) < 1e-3 and scores["class_distance"] == 0
    assert scores["precision"] == scores["recall"] == scores["coverage"] == 1
    assert sum(scores[f"class_{k}"] for k in range(10)) == pytest.approx(1)
    assert "gauge_turn" not in scores


def test_noise_and_missing_digits_are_worse():
    half = digits(32)[:297]
    good = image_scores(half, DIGITS)
    noisy = image_scores((half + 0.5 * torch.rand_like(half)).clamp(0, 1), DIGITS)
    few = half[digit_labels()[:297] < 5]
    missing = image_scores(few, DIGITS)
    for bad in (noisy, missing):
        assert bad["frechet"].value > 2 * good["frechet"].value
        assert bad["kernel_image"].value > 2 * good["kernel_image"].value
    assert noisy["precision"].value < 0.5 < good["precision"].value
    assert missing["recall"].value < 0.7 * good["recall"].value and missing["class_distance"].value > 0.4


@pytest.mark.parametrize("gauge", [Gauge(3, False, 8), Gauge(2, True, 8)])
def test_the_gauge_is_found_and_taken_back(gauge):
    turned = apply_to_images(DIGITS, gauge)
    found = best_image_gauge(turned, digits(32)[:297], 8)
    assert found == gauge.inverse
    scores = image_scores(turned, DIGITS, bins=8)
    assert scores["frechet"].value < 0.2 * image_scores(turned, DIGITS)["frechet"].value
    assert (scores["gauge_turn"].value, scores["gauge_reflected"].value) == (found.turn, found.reflected)


@pytest.mark.parametrize("gauge", [Gauge(5, False, 20), Gauge(10, True, 20), Gauge(3, False, 20), Gauge(4, True, 20)])
def test_gauged_images_look_as_their_relabelled_directions_say(gauge):
    """P(T F x, k) = P(x, view(k)): exact for quarter turns, to the blur of resampling for others."""
    x, line_integral, k = DIGITS[:8], LineIntegral(), torch.arange(8)
    angle = torch.pi / 10 * k
    seen = line_integral(apply_to_images(x, gauge), angle=angle)
    expected = line_integral(x, angle=torch.pi / 10 * gauge.view(k))
    blur = 1e-5 if gauge.turn % 5 == 0 else 0.05
    assert (seen - expected).abs().max() < blur
    assert (seen.flip(2) - expected).abs().max() > 2 * blur


def test_images_that_cannot_be_scored():
    with pytest.raises(UserError, match="at least six images"):
        image_scores(DIGITS[:5], DIGITS)
    with pytest.raises(UserError, match="at least six images"):
        image_scores(digits(16), DIGITS)
    with pytest.raises(UserError, match="NaN"):
        image_scores(DIGITS * float("nan"), DIGITS)
    with pytest.raises(UserError, match="give images"):
        digit_features(DIGITS[:, 0])


def test_pixels_of_known_sets_by_hand():
    """Three levels of grey: 0 and 1 are there, 0.5 is a quarter from the nearest of two generated ones."""
    grey = torch.tensor([0.0, 0.5, 1.0])[:, None, None, None].expand(3, 1, 4, 6)
    scores = {name: score.value for name, score in pixel_scores(torch.stack([grey[0], grey[2] - 0.25]), grey).items()}
    assert scores["mmd_rms"] == pytest.approx((0 + 0.25 + 0.25) / 3)
    assert scores["cov_rms"] == pytest.approx(2 / 3)
    copies = pixel_scores(DIGITS[:100], DIGITS[:100])
    assert copies["mmd_rms"].value == pytest.approx(0, abs=1e-3) and copies["cov_rms"].value == 1
    other = pixel_scores(DIGITS[::2], DIGITS[1::2])
    noise = pixel_scores(torch.rand(100, 1, 32, 32), DIGITS[:100])
    assert 0.4 < other["1nna_rms"].value < 0.65 and noise["1nna_rms"].value == 1
    assert "149 generated vs 148 reference" in other["mmd_rms"].protocol


@pytest.mark.parametrize(
    "generated, reference",
    [
        (torch.rand(3, 1, 8, 8), torch.rand(3, 1, 8, 9)),
        (torch.rand(3, 1, 8, 8) / 0, torch.rand(3, 1, 8, 8)),
        (torch.rand(0, 1, 8, 8), torch.rand(3, 1, 8, 8)),
    ],
)
def test_pixels_that_cannot_be_compared_are_the_users_to_mend(generated, reference):
    with pytest.raises(UserError, match="pixel scores: "):
        pixel_scores(generated, reference)


def test_digits_are_told_from_other_images():
    assert are_digits(DIGITS) and are_digits(digits(16))
    assert not are_digits(1 - DIGITS) and not are_digits(torch.rand(40, 1, 32, 32))
    assert not are_digits(birds(40, 32).amax(3)[:, None].float())
