"""What is computed in another way on a GPU is the same, on the processor or a pretended device."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch
import torch.nn.functional as F  # noqa: N812

from unproject import networks
from unproject._random import generator_at
from unproject.ops.band_statistics import band_statistics
from unproject.ops.resampling import doubled, doubled_along, gathered_pictures

sys.path.append(str(Path(__file__).parents[1] / "training"))
from pretended_device import pretended_device  # noqa: E402


@pytest.mark.parametrize("length", [1, 2, 5])
def test_doubling(length: int) -> None:
    x = torch.rand(2, 3, length, 4, generator=generator_at(0), dtype=torch.float64)
    twice = doubled_along(doubled_along(x, 2), 3)
    torch.testing.assert_close(twice, F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False))
    torch.testing.assert_close(doubled(x), twice)
    torch.testing.assert_close(doubled(x[0]), doubled_along(x[0], 2))


def test_pictures_at_places() -> None:
    rng = generator_at(1)
    x = torch.rand(2, 3, 5, 4, generator=rng, dtype=torch.float64).requires_grad_()
    grid = torch.rand(2, 6, 7, 2, generator=rng, dtype=torch.float64) * 3 - 1.5  # some of them outside
    found, wanted = gathered_pictures(x, grid), F.grid_sample(x, grid, align_corners=False)
    torch.testing.assert_close(found, wanted)
    weight = torch.rand(found.shape, generator=rng, dtype=torch.float64)
    torch.testing.assert_close(*(torch.autograd.grad(y, x, weight)[0] for y in (found, wanted)))


def test_windows_of_textures_and_statistics() -> None:
    x, head = torch.rand(4, 3, 32, 32, generator=generator_at(2)), torch.zeros(4, dtype=torch.long)
    module = networks.TextureDiscriminator((3, 32, 32), channels=4, window=16)
    here = [[w.detach() for w in module.windows(x)] for _ in range(5)]
    statistics = band_statistics(x)
    module.taken.zero_()
    with pretended_device() as device:
        module, y = module.to(device), x.to(device)
        there = [[w.detach().cpu() for w in module.windows(y)] for _ in range(5)]
        again, logits = band_statistics(y).cpu(), module(y, head.to(device))
        assert logits.isfinite().all()
    for one, other in zip(here, there, strict=True):
        assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))
    torch.testing.assert_close(statistics, again)
