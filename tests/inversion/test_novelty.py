"""Novelty: pictures of another kind are told by proportions, or by outlines."""

from __future__ import annotations

import pytest
import torch

from unproject.data import cars, chairs, observe
from unproject.inversion import DOUBTFUL, Novelty
from unproject.inversion.novelty import warped
from unproject.projections import Silhouette, azimuth_bins


def pictures(count: int, seed: int) -> torch.Tensor:
    return observe(chairs(count, 16, seed=seed), azimuth_bins(8, Silhouette(size=16)), each=4).floats()


def test_new_pictures_of_the_kind_are_known_and_others_are_not() -> None:
    train, held_out, new = pictures(100, 0), pictures(40, 1), pictures(40, 2)
    novelty = Novelty.fitted(train, held_out, steps=120)
    assert (novelty.p_values(new) < DOUBTFUL).float().mean() < 0.15
    others = observe(cars(40, 16), azimuth_bins(8, Silhouette(size=16)), each=4).floats()
    assert (novelty.p_values(others) < DOUBTFUL).float().mean() > 0.4
    assert (novelty.p_values(1 - new) < DOUBTFUL).all()
    bent = warped(new, torch.Generator().manual_seed(1))
    assert (novelty.p_values(bent) < DOUBTFUL).float().mean() > 0.5


def test_either_number_is_enough() -> None:
    novelty = Novelty.fitted(pictures(60, 0), pictures(40, 1), steps=20)
    far = torch.full((1, 1, 16, 16), 0.5)
    numbers = novelty.strangeness(far)
    for k in range(2):
        one = numbers.clone()
        one[:, 1 - k] = -1e9  # as usual as can be
        one[:, k] = 1e9
        assert _p(novelty, one) == pytest.approx(2 / 161)
        one[:, k] = -1e9
        assert _p(novelty, one) == 1


def _p(novelty: Novelty, numbers: torch.Tensor) -> float:
    class Fixed(Novelty):
        def strangeness(self, pictures: torch.Tensor) -> torch.Tensor:
            return numbers

    return Fixed(novelty.mean, novelty.axes, None, novelty.held_out).p_values(numbers).item()


def test_lines_are_compared_by_their_proportions() -> None:
    lines = torch.rand(200, 1, 16, generator=torch.Generator().manual_seed(0))
    novelty = Novelty.fitted(lines[:150], lines[150:])
    assert novelty.network is None
    assert novelty.p_values(lines[:1])[0] > 0.02 and novelty.p_values(5 * lines[:1])[0] == pytest.approx(1 / 51)


def test_warped_masks_stay_masks_of_their_size() -> None:
    masks = (pictures(4, 0) > 0.5).float()
    bent = warped(masks, torch.Generator().manual_seed(0))
    assert bent.shape == masks.shape and (bent != masks).any()
    assert set((4 * bent).unique().tolist()) <= {0.0, 1.0, 2.0, 3.0, 4.0}
