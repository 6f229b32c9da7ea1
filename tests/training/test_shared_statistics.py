"""Batch normalisation over processes: against that of torch on the whole batch, of which a process has a part."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from unproject._random import generator_at
from unproject.training import shared_statistics


class Processes:
    """Threads in place of processes: what each gives to the sum waits for the others."""

    def __init__(self, count: int) -> None:
        self.count, self.barrier, self.given = count, threading.Barrier(count), {}

    def all_reduce(self, values: Tensor) -> None:
        self.given[threading.get_ident()] = values.clone()
        self.barrier.wait(10)
        total = torch.stack([self.given[key] for key in sorted(self.given)]).sum(0)
        self.barrier.wait(10)
        values.copy_(total)

    def run(self, work: Callable[[int], None]) -> None:
        threads = [threading.Thread(target=work, args=(rank,)) for rank in range(self.count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(20)


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
