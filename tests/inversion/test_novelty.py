"""Novelty: pictures of another kind are told by proportions, or by outlines."""

from __future__ import annotations

import math

import pytest
import torch

from unproject.data import cars, chairs, observe
from unproject.inversion import DOUBTFUL, Novelty
from unproject.inversion import novelty as module
from unproject.inversion.novelty import combined, warped
from unproject.projections import Silhouette, azimuth_bins


def pictures(count: int, seed: int) -> torch.Tensor:
    return observe(chairs(count, 16, seed=seed), azimuth_bins(8, Silhouette(size=16)), each=4).floats()


def test_new_pictures_of_the_kind_are_known_and_others_are_not() -> None:
    train, held_out, new = pictures(100, 0), pictures(40, 1), pictures(40, 2)
    novelty = Novelty.fitted(train, held_out, steps=120, masks=True)
    assert (novelty.p_values(new) < DOUBTFUL).float().mean() < 0.15
    others = observe(cars(40, 16), azimuth_bins(8, Silhouette(size=16)), each=4).floats()
    assert (novelty.p_values(others) < DOUBTFUL).float().mean() > 0.4
    assert (novelty.p_values(1 - new) < DOUBTFUL).all()
    bent = warped(new, torch.Generator().manual_seed(1), masks=True)
    assert (novelty.p_values(bent) < DOUBTFUL).float().mean() > 0.5


def test_either_number_is_enough() -> None:
    novelty = Novelty.fitted(pictures(60, 0), pictures(40, 1), steps=20, masks=True)
    far = torch.full((1, 1, 16, 16), 0.5)
    numbers = novelty.strangeness(far)
    for k in range(2):
        one = numbers.clone()
        one[:, 1 - k] = -1e9  # as usual as can be
        one[:, k] = 1e9
        assert _p(novelty, one) < 1e-6
        one[:, k] = -1e9
        assert _p(novelty, one) == 1


def _p(novelty: Novelty, numbers: torch.Tensor) -> float:
    class Fixed(Novelty):
        def strangeness(self, pictures: torch.Tensor) -> torch.Tensor:
            return numbers

    return Fixed(novelty.mean, novelty.axes, None, novelty.held_out).p_values(numbers).item()


def test_lines_are_compared_by_their_proportions() -> None:
    lines = torch.rand(200, 1, 16, generator=torch.Generator().manual_seed(0))
    novelty = Novelty.fitted(lines[:150], lines[150:], masks=False)
    assert novelty.network is None
    assert novelty.p_values(lines[:1])[0] > 0.02 and novelty.p_values(5 * lines[:1])[0] < 1e-6


@pytest.mark.parametrize("shape", [(1, 4, 4), (2, 7, 16), (1, 1, 32)])
def test_pictures_too_small_for_the_network_are_compared_by_their_proportions(shape: tuple[int, ...]) -> None:
    few = torch.rand(200, *shape, generator=torch.Generator().manual_seed(0))
    novelty = Novelty.fitted(few[:150], few[150:], steps=1, masks=False)
    assert novelty.network is None and novelty.p_values(5 * few[:1])[0] < 1e-6


def test_warped_masks_stay_masks_of_their_size() -> None:
    masks = (pictures(4, 0) > 0.5).float()
    bent = warped(masks, torch.Generator().manual_seed(0), masks=True)
    assert bent.shape == masks.shape and (bent != masks).any()
    assert set((4 * bent).unique().tolist()) <= {0.0, 1.0, 2.0, 3.0, 4.0}


def stripes(count: int, seed: int) -> torch.Tensor:
    """Straight grey stripes."""
    rng = torch.Generator().manual_seed(seed)
    phase, contrast = 6.28 * torch.rand(count, 1, generator=rng), 0.2 + 0.2 * torch.rand(count, 1, generator=rng)
    wave = 0.5 + contrast * torch.sin(torch.linspace(0, 12.6, 32) + phase)
    return wave[:, None, None].expand(-1, 1, 32, 32).contiguous()


def test_grey_pictures_are_warped_as_they_are() -> None:
    train, new = stripes(120, 0), stripes(40, 1)
    bent = torch.stack([y.roll(int(3 * math.sin(0.2 * k)), -1) for k, y in enumerate(stripes(40, 2).unbind(2))], 2)
    novelty = Novelty.fitted(train, new, steps=40, masks=False)
    stranger = novelty.strangeness(bent)[:, None, 1] > novelty.strangeness(new)[None, :, 1]
    assert stranger.float().mean() > 0.9


def test_warped_photographs_have_no_rims() -> None:
    """Training pictures have none, so that rims would tell warped ones."""
    bright = torch.full((16, 3, 32, 32), 0.8)
    torch.testing.assert_close(warped(bright, torch.Generator().manual_seed(0), masks=False), bright)
    full = torch.ones(16, 1, 32, 32)
    assert (warped(full, torch.Generator().manual_seed(0), masks=True) == 0).any()


def test_components_of_many_pictures_are_nearly_those_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = torch.Generator().manual_seed(3)
    pictures = torch.randn(200, 60, generator=rng) / torch.arange(1, 61) @ torch.randn(60, 1024, generator=rng)
    pictures = pictures.view(200, 1, 32, 32)
    exact = Novelty.fitted(pictures, pictures[:50], steps=1, masks=True)
    monkeypatch.setattr(module, "MAX_EXACT_SIDE", 8)
    state = torch.get_rng_state()
    quick = Novelty.fitted(pictures, pictures[:50], steps=1, masks=True)
    assert torch.equal(state, torch.get_rng_state())
    torch.testing.assert_close(quick.held_out[:, 0], exact.held_out[:, 0], rtol=0.05, atol=0)
    monkeypatch.setattr(module, "MAX_PIXELS", 64 * 32 * 32)
    assert Novelty.fitted(pictures, pictures[:50], steps=1, masks=True).axes.shape == (32, 1024)


def test_few_held_out_pictures_tell_what_is_far_beyond_them() -> None:
    """Twenty held-out ones: a share alone could not be below a twentieth."""
    rng = torch.Generator().manual_seed(0)
    train, new = torch.randn(400, 1, 8, generator=rng), torch.randn(400, 1, 8, generator=rng)
    called = []
    for held_out in torch.randn(20, 20, 1, 8, generator=rng):
        novelty = Novelty.fitted(train, held_out, masks=False)
        called.append((novelty.p_values(new) < DOUBTFUL).float().mean().item())
        assert novelty.p_values(6 * torch.ones(1, 1, 8)).item() < DOUBTFUL
    assert sum(called) / len(called) < 2 * DOUBTFUL
    single = Novelty.fitted(train, train[:1], masks=False)
    assert single.p_values(6 * torch.ones(1, 1, 8)).item() == 0.5


def test_one_odd_picture_of_many_does_not_make_an_object_odd() -> None:
    assert combined(torch.tensor([0.02])) == pytest.approx(0.02)
    assert combined(torch.tensor([0.02, *[0.5] * 5])) > 0.03
    assert combined(torch.full((6,), 0.02)) == pytest.approx(0.02)
