"""Batch normalisation over processes: against that of torch on the whole batch, of which a process has a part."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn
from toy import toy

from unproject._random import generator_at
from unproject._types import UserError
from unproject.adversarial import R1R2
from unproject.networks import DCGANDiscriminator
from unproject.training import shared_statistics
from unproject.training.state import State


class Processes:
    """Threads in place of processes: what each gives to the sum waits for the others."""

    def __init__(self, count: int) -> None:
        self.count, self.barrier, self.given = count, threading.Barrier(count), {}

    def all_reduce(self, values: Tensor) -> None:
        self.given[threading.get_ident()] = values.clone()
        self.barrier.wait(60)
        total = torch.stack([self.given[key] for key in sorted(self.given)]).sum(0)
        self.barrier.wait(60)
        values.copy_(total)

    def run(self, work: Callable[[int], None]) -> None:
        threads = [threading.Thread(target=work, args=(rank,)) for rank in range(self.count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(120)


@pytest.mark.parametrize(("norm", "shape"), [(nn.BatchNorm1d, (5,)), (nn.BatchNorm2d, (5, 3, 4))])
def test_parts_are_normalised_as_the_whole_is(
    norm: type[nn.Module], shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    rng, processes = generator_at(0), Processes(2)
    monkeypatch.setattr(shared_statistics.dist, "all_reduce", processes.all_reduce)
    monkeypatch.setattr(shared_statistics.dist, "is_initialized", lambda: True)
    monkeypatch.setattr(shared_statistics.dist, "get_world_size", lambda: 2)
    whole = norm(shape[0]).double()
    nn.init.normal_(whole.weight)
    nn.init.normal_(whole.bias)
    parts = [copy.deepcopy(whole), copy.deepcopy(whole)]
    x = (3 + 2 * torch.randn(8, *shape, generator=rng, dtype=torch.float64)).requires_grad_()
    toward = torch.randn(8, *shape, generator=rng, dtype=torch.float64)
    halves = [half.detach().clone().requires_grad_() for half in x.chunk(2)]
    found: dict[int, Tensor] = {}

    def work(rank: int) -> None:
        found[rank] = shared_statistics.share_statistics(parts[rank])(halves[rank])
        (found[rank] * toward.chunk(2)[rank]).sum().backward()

    processes.run(work)
    y = whole(x)
    (y * toward).sum().backward()
    torch.testing.assert_close(torch.cat([found[0], found[1]]), y)
    torch.testing.assert_close(torch.cat([half.grad for half in halves]), x.grad)
    torch.testing.assert_close(parts[0].weight.grad + parts[1].weight.grad, whole.weight.grad)
    for part in parts:
        torch.testing.assert_close(part.state_dict(), whole.state_dict())
        torch.testing.assert_close(part.eval()(x), copy.deepcopy(whole).eval()(x))


def test_one_process_keeps_what_torch_does() -> None:
    module = nn.Sequential(nn.BatchNorm2d(3))
    assert type(shared_statistics.share_statistics(module)[0]) is nn.BatchNorm2d


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch) -> Processes:
    """Two processes."""
    processes = Processes(2)
    monkeypatch.setattr(shared_statistics.dist, "all_reduce", processes.all_reduce)
    monkeypatch.setattr(shared_statistics.dist, "is_initialized", lambda: True)
    monkeypatch.setattr(shared_statistics.dist, "get_world_size", lambda: 2)
    return processes


def test_statistics_of_half_precision_are_single(two: Processes) -> None:
    """Numbers around 100 whose deviation is 1: of bfloat16's squares nothing would be left."""
    whole = nn.BatchNorm2d(5)
    parts = [shared_statistics.share_statistics(copy.deepcopy(whole)) for _ in range(2)]
    x = (100 + torch.randn(64, 5, 3, 4, generator=generator_at(0))).bfloat16()
    halves = [half.clone().requires_grad_() for half in x.chunk(2)]
    found: dict[int, Tensor] = {}

    def work(rank: int) -> None:
        with torch.autocast("cpu", torch.bfloat16):
            found[rank] = parts[rank](halves[rank])
        found[rank].float().square().mean().backward()

    two.run(work)
    assert {y.dtype for y in found.values()} == {torch.bfloat16} == {half.grad.dtype for half in halves}  # type: ignore[union-attr]
    torch.testing.assert_close(torch.cat([found[0], found[1]]).float(), whole(x.float()), atol=0.03, rtol=0.01)
    torch.testing.assert_close(parts[0].running_var, whole.running_var, rtol=1e-3, atol=0)


def test_large_means_leave_the_deviation(two: Processes) -> None:
    """A mean ten thousand times the deviation: its square in single precision has no digit of the variance."""
    whole = nn.BatchNorm1d(5, eps=1e-9).double()
    part = shared_statistics.share_statistics(copy.deepcopy(whole).float())
    x = 1000 + 0.1 * torch.randn(4096, 5, generator=generator_at(0), dtype=torch.float64)
    found: dict[int, Tensor] = {}
    parts = [part, copy.deepcopy(part)]

    def work(rank: int) -> None:
        found[rank] = parts[rank](x.float().chunk(2)[rank])

    two.run(work)
    torch.testing.assert_close(torch.cat([found[0], found[1]]).double(), whole(x), atol=0.02, rtol=0)


def test_nothing_is_differentiated_through_twice(two: Processes) -> None:
    """A gradient penalty would be wrong without a word."""
    part = shared_statistics.share_statistics(nn.BatchNorm1d(3))
    x, said = torch.randn(4, 3, requires_grad=True), []

    def work(rank: int) -> None:
        (g,) = torch.autograd.grad(part(x).square().sum(), x, create_graph=True)
        try:
            g.square().sum().backward()
        except RuntimeError as error:
            said.append(str(error))

    two.run(work)
    assert len(said) == 2 and all("once_differentiable" in one for one in said)


def test_a_penalty_of_a_discriminator_with_shared_statistics_is_refused(two: Processes) -> None:
    recipe = toy(steps=1).replace(discriminator=DCGANDiscriminator, normalise_over="processes", penalty=R1R2())
    with pytest.raises(UserError, match="a gradient penalty cannot be differentiated through the batch normalisation"):
        State(recipe, torch.device("cpu"))
    State(recipe.replace(penalty=None), torch.device("cpu"))
