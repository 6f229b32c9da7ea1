"""Networks that begin with what one of half the size has learned."""

from __future__ import annotations

from typing import Literal

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from unproject._random import seeded
from unproject._types import UserError
from unproject.networks import Discriminator, LowRankGenerator, MultiScaleDiscriminator, ViewPredictor
from unproject.networks.blocks import SmoothUpsampling, doubled

HEAD = torch.tensor([0, 2, 2, 1])
SMALL = {"channels": 4, "shared": 4, "bottleneck": 8}


def generator(size: int, mirror: bool | Literal["z"] = False, channels: int = 16, rank: int = 4) -> LowRankGenerator:
    with seeded(size, "test"):
        return LowRankGenerator(size=size, code_size=6, channels=channels, rank=rank, mirror=mirror)


def learned(size: int, mirror: bool | Literal["z"] = False) -> LowRankGenerator:
    """Whose norms have moved, and whose volumes are neither empty nor full."""
    made = generator(size, mirror)
    codes = made.draw(64, torch.Generator().manual_seed(0))
    for _ in range(20):
        made(codes)
    with torch.no_grad():
        made.bias.fill_(0.0)
        for part in (*made.planes, *made.lines):
            assert isinstance(part, SmoothUpsampling)
            part.get_submodule("last").get_parameter("weight").mul_(6)
    return made.eval()


@pytest.mark.parametrize("mirror", [False, True, "z"])
def test_a_grown_generator_makes_the_volumes_of_the_smaller_one(mirror: bool | Literal["z"]) -> None:
    small, large = learned(16, mirror), generator(32, mirror).eval()
    code = small.codes(12, seed=3)
    with torch.no_grad():
        expected, before = small.at_size(code, 32), large(code)
        large.grow(small.state_dict())
        found = large(code)
    assert (found - expected).abs().mean() < 0.15 * (before - expected).abs().mean()


def test_the_new_level_interpolates() -> None:
    with seeded(0, "test"):
        block = SmoothUpsampling(inputs=5, channels=8, outputs=4, shape=(16, 16), levels=2)
    hidden, seen = torch.randn(64, 5), []
    for _ in range(100):
        block(hidden)
    block.eval().pass_through(hidden)
    block.levels[1].register_forward_pre_hook(lambda module, given: seen.append(given[0]))
    block.last.register_forward_pre_hook(lambda module, given: seen.append(given[0]))
    for training in (False, True):
        block.train(training)(hidden)
        before, after = seen[-2:]
        torch.testing.assert_close(after, doubled(before), rtol=0, atol=0.1 if training else 2e-6)


def test_the_new_level_learns() -> None:
    large = generator(32)
    large.grow(learned(16).state_dict())
    large(large.codes(4)).sum().backward()
    level = large.planes[0].get_submodule("levels.2").get_parameter("weight")
    assert level.grad is not None and bool(level.grad.any())


def test_a_grown_generator_is_in_the_mode_it_was_in() -> None:
    for training in (False, True):
        large = generator(32).train(training)
        large.grow(learned(16).state_dict())
        assert large.training == training and all(part.training == training for part in large.modules())


@pytest.mark.parametrize("other", [generator(32), generator(8), generator(16, channels=32), generator(16, rank=8)])
def test_other_generators_are_refused_and_nothing_is_taken(other: LowRankGenerator) -> None:
    large = generator(32)
    before = {name: value.clone() for name, value in large.state_dict().items()}
    with pytest.raises(UserError, match="of no generator of 16 voxels"):
        large.grow(other.state_dict())
    assert all(torch.equal(before[name], value) for name, value in large.state_dict().items())


def test_a_level_that_loses_channels_cannot_begin_as_the_identity() -> None:
    with pytest.raises(UserError, match="lower channels, or raise rank"):
        generator(32, channels=64).grow(generator(16, channels=64).state_dict())


def told(discriminator: nn.Module, y: Tensor, head: Tensor = HEAD) -> Tensor:
    with torch.no_grad():
        return discriminator(y, head)


def judge(side: int) -> Discriminator:
    with seeded(side, "test"):
        made = Discriminator((1, side, side), 3, common=True, **SMALL)
        nn.init.normal_(made.get_parameter("common"))
        nn.init.normal_(made.last.weight)
        return made


def scales(side: int, coarsest: int = 16) -> MultiScaleDiscriminator:
    with seeded(1, "test"):
        return MultiScaleDiscriminator((1, side, side), 3, coarsest, **SMALL)


def test_a_grown_discriminator_sees_what_the_smaller_one_saw() -> None:
    y, small, middle, large = torch.rand(4, 1, 64, 64), judge(16), scales(32), scales(64)
    middle.grow(small.state_dict())
    assert torch.equal(told(middle, y[..., ::2, ::2]), told(small, F.avg_pool2d(y[..., ::2, ::2], 2)))
    large.grow(middle.state_dict())
    torch.testing.assert_close(told(large, y), told(small, F.avg_pool2d(y, 4)))


def test_logits_of_all_scales_are_added() -> None:
    y, found = torch.rand(4, 1, 32, 32), scales(32)
    coarse, fine = found.scales
    with torch.no_grad():
        for part in (coarse, fine):
            nn.init.normal_(part.get_parameter("common"))
    torch.testing.assert_close(told(found, y), told(coarse, F.avg_pool2d(y, 2)) + told(fine, y))


def test_the_finest_scale_begins_at_zero_and_learns() -> None:
    y, found = torch.rand(4, 1, 32, 32), scales(32)
    fine = found.scales[1]
    assert not told(fine, y).any()
    found(y, HEAD).sum().backward()
    gradient = fine.get_parameter("common").grad
    assert gradient is not None and bool(gradient.any())


@pytest.mark.parametrize("side, coarsest", [(16, 32), (48, 16), (80, 16)])
def test_sides_that_are_no_doublings_are_refused(side: int, coarsest: int) -> None:
    with pytest.raises(UserError, match=f"{side} x {side} is not {coarsest} a side"):
        scales(side, coarsest)


@pytest.mark.parametrize("other", [judge(32), scales(64), scales(16), nn.Linear(2, 2)])
def test_other_discriminators_are_refused(other: nn.Module) -> None:
    with pytest.raises(UserError, match="of no such discriminator"):
        scales(64).grow(other.state_dict())


def test_of_one_with_other_heads_nothing_is_taken() -> None:
    large, other = scales(32), Discriminator((1, 16, 16), 4, common=True, **SMALL)
    before = {name: value.clone() for name, value in large.state_dict().items()}
    with pytest.raises(UserError, match="of no such discriminator"):
        large.grow(other.state_dict())
    assert all(torch.equal(before[name], value) for name, value in large.state_dict().items())


def test_it_may_be_replayed_where_its_scales_may() -> None:
    assert scales(32).replayable
    assert not MultiScaleDiscriminator((1, 32, 32), 3, 16, channels=4, shared=2).replayable


@pytest.mark.parametrize("shape, most, times", [((1, 64, 64), 32, 2), ((1, 128, 64), 16, 4), ((1, 96), 32, 3)])
def test_a_view_predictor_of_large_images_is_that_of_their_means(shape: tuple[int, ...], most: int, times: int) -> None:
    large = ViewPredictor(shape, 5, channels=2, most=most).eval()
    small = ViewPredictor((1, *(side // times for side in shape[1:])), 5, channels=2).eval()
    small.load_state_dict(large.state_dict())
    y = torch.rand(3, *shape)
    mean = (F.avg_pool2d if len(shape) == 3 else F.avg_pool1d)(y, times)
    torch.testing.assert_close(large(y), small(mean))


def test_small_images_are_left_as_they_are() -> None:
    predictor = ViewPredictor((1, 16, 16), 5, channels=2, most=32)
    assert predictor.times == 1 and predictor(torch.rand(2, 1, 16, 16)).shape == (2, 5)


def test_images_that_cannot_be_averaged_are_refused() -> None:
    with pytest.raises(UserError, match="cannot be averaged over 2 pixels"):
        ViewPredictor((1, 64, 65), 5, most=32)
