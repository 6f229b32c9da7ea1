"""Randomness: every draw is a function of (seed, step, stream) and of nothing else."""

from __future__ import annotations

import hashlib
import itertools

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject._random import derived_seed, generator_at, seeded


@settings(deadline=None, max_examples=50)
@given(st.integers(), st.integers(0), st.text(max_size=20))
def test_a_seed_is_the_hash_of_where_it_stands(seed: int, step: int, stream: str) -> None:
    digest = hashlib.sha256(f"{seed}/{step}/{stream}".encode()).digest()
    found = derived_seed(seed, step, stream)
    assert 0 <= found < 2**63
    assert found == sum(byte << 8 * i for i, byte in enumerate(digest[:8])) >> 1


def test_seeds_do_not_change_between_versions() -> None:
    # Runs are resumed under newer versions: these must stay.
    assert derived_seed(0) == 3637447582827775887
    assert derived_seed(7, 3, "codes/0") == 3710254362896263964


def test_all_places_have_their_own_draws() -> None:
    places = list(itertools.product((0, 1, -1), (0, 1, 11), ("", "a", "1/a")))
    draws = {tuple(torch.rand(2, generator=generator_at(*place)).tolist()) for place in places}
    assert len(draws) == len(places)


def test_a_generator_ignores_the_global_state_and_leaves_it() -> None:
    torch.manual_seed(1)
    before = torch.get_rng_state()
    first = torch.rand(3, generator=generator_at(5, 2, "x"))
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(2)
    assert torch.equal(first, torch.rand(3, generator=generator_at(5, 2, "x")))


def test_a_seeded_block_is_reproducible_and_puts_the_global_state_back() -> None:
    torch.manual_seed(1)
    before = torch.get_rng_state()
    with seeded(3, "weights"):
        first = torch.rand(3)
    assert torch.equal(torch.get_rng_state(), before)
    with seeded(3, "weights"):
        assert torch.equal(torch.rand(3), first)
    with seeded(3, "other"):
        assert not torch.equal(torch.rand(3), first)
    with seeded(4, "weights"):
        assert not torch.equal(torch.rand(3), first)


def test_the_global_state_is_put_back_after_an_error() -> None:
    before = torch.get_rng_state()
    try:
        with seeded(3):
            torch.rand(1)
            raise RuntimeError
    except RuntimeError:
        pass
    assert torch.equal(torch.get_rng_state(), before)
