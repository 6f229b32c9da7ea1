"""The only source of randomness: a generator derived from (seed, step, stream).

Nothing in the package draws from the global state of torch, numpy or Python. Every draw depends on its place in the run
alone, so a resumed run repeats the draws of an uninterrupted one. Layers of a user's own do, such as dropout: each step
of training, each assignment and each step of a view predictor's fit seeds torch's global source for them
(`seed_globally`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager

import torch


def derived_seed(seed: int, step: int = 0, stream: str = "") -> int:
    """Return a 63-bit seed: the first bytes of the SHA-256 of `seed/step/stream`."""
    digest = hashlib.sha256(f"{seed}/{step}/{stream}".encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 1


def generator_at(seed: int, step: int = 0, stream: str = "") -> torch.Generator:
    """Return a CPU generator whose draws depend on (seed, step, stream) alone.

    Draws are made on the CPU and moved to the device, so that they do not depend on the device.

    Examples:
        >>> import torch
        >>> first, second = (torch.rand(2, generator=generator_at(0, 5, "codes")) for _ in range(2))
        >>> torch.equal(first, second)
        True
    """
    return torch.Generator().manual_seed(derived_seed(seed, step, stream))


@contextmanager
def seeded(seed: int, stream: str = "") -> Iterator[None]:
    """Run a block under a global torch seed, for code that takes no generator: weight initialisation."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derived_seed(seed, 0, stream) % 2**63)
        yield


@contextmanager
def own_random_state(device: torch.device) -> Iterator[None]:
    """Run a block that seeds torch's global sources, and give them back as they were."""
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        yield


def seed_globally(seed: int, step: int, stream: str) -> None:
    """Seed torch's global sources, of all devices, by (seed, step, stream)."""
    torch.manual_seed(derived_seed(seed, step, stream))


class BatchShard(torch.Generator):
    """The source of draws of one process among several, each of which has its part of one batch.

    Drawn from directly, its draws are another process's nowhere. `shared_draws` take the draws of the whole batch from
    `whole`, which is the same in all processes, and keep their own: then `world` processes with a batch of b draw what
    one does with a batch of world · b, whose draws are those of process 0.

    Attributes:
        whole: the generator of the whole batch.
        rank: of this process, which has the part of this number, of `world`.
        rows: the rows of real images of the whole batch, if there are such.
        chosen: (how many elements of the whole batch are drawn for, how many of them come before the own ones), if
            these are not all.
    """

    whole: torch.Generator
    rank: int
    world: int
    rows: torch.Tensor | None
    chosen: tuple[int, int] | None


def part_at(
    seed: int, step: int, stream: str, rank: int = 0, world: int = 1, rows: torch.Tensor | None = None
) -> torch.Generator:
    """Return the generator of a process: that of (seed, step, stream/rank); of several processes a `BatchShard`."""
    if world == 1:
        return generator_at(seed, step, f"{stream}/{rank}")
    part = BatchShard()
    part.manual_seed(derived_seed(seed, step, f"{stream}/{rank}"))
    part.whole, part.rank, part.world = generator_at(seed, step, f"{stream}/0"), rank, world
    part.rows, part.chosen = rows, None
    return part


def shared_draws(rng: torch.Generator, n: int) -> tuple[torch.Generator, int, slice]:
    """Return what to draw from for n elements, for how many to draw, and which of these are the own ones.

    Examples:
        >>> rng, count, own = shared_draws(generator_at(0, 5, "codes"), 2)
        >>> count, torch.rand(count, generator=rng)[own].shape
        (2, torch.Size([2]))
        >>> one, two = (part_at(0, 5, "codes", rank, world=2) for rank in (0, 1))
        >>> [shared_draws(rng, 2)[1:] for rng in (one, two)]
        [(4, slice(0, 2, None)), (4, slice(2, 4, None))]
    """
    if not isinstance(rng, BatchShard):
        return rng, n, slice(0, n)
    count, first = rng.chosen or (n * rng.world, n * rng.rank)
    first = min(first, count - n)  # of none that are chosen, one is drawn for
    return rng.whole, count, slice(first, first + n)


def rows_of_all(rng: torch.Generator, rows: torch.Tensor) -> torch.Tensor:
    """Return the rows of the whole batch, of which `rows` are this process's."""
    return rng.rows if isinstance(rng, BatchShard) and rng.rows is not None else rows


def chosen_of(rng: torch.Generator, whole: torch.Tensor, own: slice) -> torch.Generator:
    """Return the source of draws for those elements alone that `whole` (N,), bool, chooses."""
    if not isinstance(rng, BatchShard):
        return rng
    part = BatchShard()
    part.manual_seed(int(torch.randint(2**62, (), generator=rng)))
    part.whole, part.rank, part.world, part.rows = rng.whole, rng.rank, rng.world, None
    part.chosen = int(whole.sum()), int(whole[: own.start].sum())
    return part
