"""The only source of randomness: a generator derived from (seed, step, stream).

Nothing in the package draws from the global state of torch, numpy or Python. Every draw depends on its place in the run
alone, so a resumed run repeats the draws of an uninterrupted one.
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
