"""Sets of pictures with grey values are compared by their root mean square differences."""

from __future__ import annotations

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.domains import Volumes
from unproject.metrics import picture_scores
from unproject.metrics.picture_sets import root_mean_square


def pictures(n: int, seed: int) -> torch.Tensor:
    return torch.rand(n, 1, 8, 8, generator=generator_at(seed))


@pytest.mark.parametrize("offset", [0.9, 100.0, 1e4])
def test_what_pictures_have_in_common_costs_no_digits(offset: float) -> None:
    rng = torch.Generator().manual_seed(0)
    a, b = (offset + torch.randn(40, 1, 16, 16, generator=rng) for _ in "ab")
    plain = (a[:, None].double() - b[None].double()).square().mean((2, 3, 4)).sqrt().float()
    torch.testing.assert_close(root_mean_square(a, b), plain, rtol=1e-5, atol=0)
    assert root_mean_square(a, a).diagonal().max() < 1e-6  # of 32 bits up to 1e-3


def test_the_distance_is_the_root_mean_square_difference() -> None:
    a, b = pictures(3, 0), pictures(2, 1)
    plain = (a[:, None] - b[None]).square().flatten(2).mean(2).sqrt()
    torch.testing.assert_close(root_mean_square(a, b), plain)


def test_pictures_that_agree_in_being_above_a_half_differ() -> None:
    """1 - IoU of such pictures at a half is 0."""
    light = 0.6 + 0.4 * pictures(12, 0)
    scores = picture_scores(0.6 + 0.4 * pictures(12, 1), light)
    assert scores["mmd_rms_picture"].value > 0.05
    assert picture_scores(light, light)["mmd_rms_picture"].value < 1e-3
    assert Volumes().projection_scores(light, light).keys() == scores.keys()
    assert "mmd_iou_silhouette" in Volumes().projection_scores(light, light, silhouettes=True)
    assert Volumes().picture_distance(False) is root_mean_square is not Volumes().picture_distance(True)


def test_a_picture_that_is_no_number_is_refused() -> None:
    with pytest.raises(UserError):
        picture_scores(pictures(4, 0) * float("nan"), pictures(4, 1))


@pytest.mark.parametrize("other", [pictures(1, 1), pictures(4, 1).reshape(4, 1, 4, 16), pictures(4, 1)[..., 1:]])
def test_single_pictures_and_those_of_other_sizes_are_refused(other: torch.Tensor) -> None:
    for sets in ((pictures(4, 0), other), (other, pictures(4, 0))):
        with pytest.raises(UserError, match="at least two pictures of one size"):
            picture_scores(*sets)
