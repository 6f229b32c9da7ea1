"""What is said of views, from probabilities whose information is known."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject.assignment import Panel, Predicted, Unassigned
from unproject.assignment.view_findings import chance, information, view_findings
from unproject.data import chairs, observe
from unproject.metrics import worst
from unproject.projections.silhouette import Silhouette, azimuth_bins

K = 8


def probabilities(certainty: float, n: int = 64, used: int = K) -> Tensor:
    """The first views that are used equally often, each time with this probability and the rest shared evenly."""
    p = torch.full((n, K), (1 - certainty) / (K - 1))
    p[torch.arange(n), torch.arange(n) % used] = certainty
    return p


def test_certain_predictions_hold_log_k_nats_and_even_ones_none() -> None:
    assert information(probabilities(1.0)) == pytest.approx(math.log(K), abs=1e-5)
    assert information(probabilities(1 / K)) == pytest.approx(0.0, abs=1e-5)


def test_chance_is_what_random_certainty_seems_to_hold() -> None:
    """The plug-in information of random labels, many times over."""
    n, rng = 256, torch.Generator().manual_seed(0)
    labels, views = torch.randint(K, (2, 200, n), generator=rng)
    found = []
    for label, view in zip(labels, views, strict=True):
        joint = torch.bincount(label * K + view, minlength=K * K).view(K, K) / n
        independent = joint.sum(1, keepdim=True) * joint.sum(0, keepdim=True)
        found.append((joint * (joint / independent).clamp_min(1e-12).log()).sum().item())
    assert sum(found) / len(found) == pytest.approx((K - 1) * chance(n, K), rel=0.1)


def words(real: float, generated: float) -> dict[str, str]:
    return {f.name: f.word for f in view_findings(probabilities(real), probabilities(generated))}


def test_views_are_found_if_pictures_tell_them() -> None:
    assert words(0.95, 0.95) == {"views": "good", "world": "good"}


def test_pictures_from_few_sides_have_less_to_tell() -> None:
    """Of two views alone ln 2 at most, which is less than 0.4 of ln 8."""
    few = probabilities(0.98, used=2)
    assert information(few) < 0.4 * math.log(K)
    assert [f.word for f in view_findings(few, probabilities(0.98))] == ["good", "good"]
    unsure = probabilities(0.3, used=2)
    assert [f.word for f in view_findings(unsure, probabilities(0.98))] == ["doubtful", "failed"]


def test_views_of_pictures_that_are_all_of_one_are_not_found() -> None:
    one = probabilities(0.999, used=1)
    one[0] = one[0].flip(0)  # but for one of them
    assert [f.word for f in view_findings(one, one)] == ["doubtful"]


def test_little_information_in_both_is_not_decided() -> None:
    (views,) = view_findings(probabilities(0.2), probabilities(0.2))
    assert views.word == "doubtful" and "look alike from all sides" in views.says and "known views" in views.advice


def test_a_world_more_telling_than_the_pictures_has_failed() -> None:
    assert words(0.3, 0.99) == {"views": "doubtful", "world": "failed"}
    assert worst(view_findings(probabilities(0.75), probabilities(0.95))) == "doubtful"


def disc_and_wedge() -> tuple[Tensor, Tensor]:
    """64 silhouettes that are their own mirror images, and as many that are not."""
    row, column = torch.meshgrid(torch.arange(16), torch.arange(16), indexing="ij")
    disc, wedge = (row - 8).square() + (column - 8).square() < 30, column <= row
    return disc.float().expand(64, 1, 16, 16), wedge.float().expand(64, 1, 16, 16)


def test_views_of_pictures_that_are_their_own_mirror_images_are_in_doubt() -> None:
    disc, wedge = disc_and_wedge()
    p = probabilities(0.95)
    mirror, *_ = found = view_findings(p, p, disc)
    assert mirror.word == worst(found) == "doubtful"
    assert "round objects would explain them as well" in mirror.says and "--axisymmetric" in mirror.advice
    assert [f.name for f in view_findings(p, p, wedge)] == ["views", "world"]


def test_found_views_of_mirror_images_are_in_doubt_though_those_of_shapes_cannot_be_told() -> None:
    disc, _ = disc_and_wedge()
    assert [(f.name, f.word) for f in view_findings(probabilities(0.95), probabilities(0.2), disc)] == [
        ("mirror", "doubtful"),
        ("views", "good"),
    ]


def test_views_of_mirror_images_that_nothing_tells_stay_in_doubt() -> None:
    p = probabilities(0.2)
    for pictures in disc_and_wedge():
        (views,) = view_findings(p, p, pictures)
        assert views.name == "views" and views.word == "doubtful"


def test_shares_of_views_are_told_where_they_are_known() -> None:
    views = azimuth_bins(4, Silhouette(size=16))
    seen = observe(chairs(6, 16), views, 2)
    panel = Panel(views, seen)
    shares = panel.assignment.begin(panel, 0).view_shares(seen.floats())
    assert shares is not None and shares.sum() == pytest.approx(1.0)
    assert torch.equal((12 * shares).round().long(), torch.bincount(seen.latents["view"].long(), minlength=4))
    for unknown in (Unassigned(), Predicted()):  # a predictor that was never fitted finds nothing
        assert unknown.begin(Panel(views, seen, unknown), 0).view_shares(seen.floats()) is None
