"""Scores up to the turn of each image: what lines leave open costs nothing, anything else does."""

from __future__ import annotations

from importlib.resources import files

import pytest
import torch
from safetensors import safe_open
from torch import Tensor

from unproject._types import UserError
from unproject.data import digit_labels, digits
from unproject.metrics import Gauge, dihedral, image_scores, open_gauges, randomly_turned, turned_scores
from unproject.metrics.digit_classifier import TURNED, digit_features
from unproject.ops import rotate_image
from unproject.projections.line_integral import LineIntegral, directions

TRUE, OTHERS = digits(32, held_out=True), digits(32)[:600]


def values(generated: Tensor) -> dict[str, float]:
    return {name: score.value for name, score in turned_scores(generated, TRUE).items()}


@pytest.mark.parametrize("count", [6, 10])
def test_open_gauges_change_no_line(count: int) -> None:
    """P(g x, k) = P(x, g(k)), and g(k) is one of the directions that are measured."""
    gauges, lines = open_gauges(count), LineIntegral()
    assert len(gauges) == 2 and gauges[0] == Gauge(0, False, 2 * count)
    middles = [o.prior.sample(1, torch.Generator().manual_seed(0))["angle"].item() for o in directions(count, 1e-9)]
    images = OTHERS[:16]
    for gauge in gauges:
        turned = randomly_turned(images, (gauge,), 0)
        for k in range(count):
            seen = int(gauge.view(torch.tensor(k)))
            found, wanted = (lines(x, angle=torch.full((16,), middles[j])) for x, j in ((turned, k), (images, seen)))
            assert (found - wanted).abs().mean() < 0.04 * wanted.mean()


def test_each_image_is_turned_by_itself() -> None:
    gauges = dihedral(20)
    turned = randomly_turned(TRUE[:1].expand(400, -1, -1, -1), gauges, 3)
    assert len(torch.unique(turned.flatten(1).round(decimals=3), dim=0)) == 40
    assert torch.equal(turned, randomly_turned(TRUE[:1].expand(400, -1, -1, -1), gauges, 3))
    assert not torch.equal(turned, randomly_turned(TRUE[:1].expand(400, -1, -1, -1), gauges, 4))


def test_the_classifier_knows_turned_digits_it_never_saw() -> None:
    labels = digit_labels(held_out=True)
    turned = randomly_turned(TRUE, dihedral(20), 0)
    right = (digit_features(turned, TURNED)[1] == labels).double().mean().item()
    assert right > 0.88 > 0.5 > (digit_features(turned)[1] == labels).double().mean().item()
    with safe_open(str(files("unproject.metrics") / f"{TURNED}.safetensors"), "pt") as stored:
        about = stored.metadata()
    assert float(about["accuracy_mnist"]) > 0.9 and float(about["accuracy_embedded"]) > 0.88


def test_worlds_that_lines_cannot_tell_apart_score_alike() -> None:
    true = values(OTHERS)
    assert max(true["frechet_mirrored"], true["frechet_turned"]) < 25
    half = values(randomly_turned(OTHERS, open_gauges(10), 9))
    anyhow = values(randomly_turned(OTHERS, dihedral(20), 9))
    assert half["frechet_mirrored"] < 1.3 * true["frechet_mirrored"]
    assert anyhow["frechet_turned"] < 1.3 * true["frechet_turned"]
    assert anyhow["recall_turned"] > 0.8 * true["recall_turned"]
    upright = {
        name: image_scores(x, TRUE)["frechet"].value for name, x in (("true", OTHERS), ("half", half_mirrored()))
    }
    assert upright["half"] > 1.8 * upright["true"], "which the upright score does not forgive"


def half_mirrored() -> Tensor:
    return randomly_turned(OTHERS, open_gauges(10), 9)


def test_other_worlds_score_worse() -> None:
    true = values(OTHERS)
    noisy = values((OTHERS + 0.4 * torch.rand(OTHERS.shape, generator=torch.Generator().manual_seed(1))).clamp(0, 1))
    blurred = values(rotate_image(rotate_image(OTHERS, torch.full((600,), 0.3)), torch.full((600,), -0.3)))
    few = values(OTHERS[digit_labels()[:600] < 5])
    for name in ("mirrored", "turned"):
        assert noisy[f"frechet_{name}"] > 2 * true[f"frechet_{name}"]
        assert blurred[f"frechet_{name}"] > 1.05 * true[f"frechet_{name}"]
        assert few[f"frechet_{name}"] > 1.2 * true[f"frechet_{name}"]
        assert few[f"recall_{name}"] < true[f"recall_{name}"]
    turned = values(randomly_turned(OTHERS, dihedral(20), 9))
    assert turned["frechet_mirrored"] > 1.5 * true["frechet_mirrored"], "ten directions tell a turn"


def test_a_set_that_cannot_be_scored() -> None:
    with pytest.raises(UserError, match="six square images"):
        turned_scores(TRUE[:5], TRUE)
    with pytest.raises(UserError, match="six square images"):
        turned_scores(TRUE[:, :, 2:], TRUE)
