"""Resumable sampling: every row once an epoch, whoever asks and whenever."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject._types import UserError
from unproject.data import batch_rows
from unproject.data.sampling import spread_rows


@settings(max_examples=60, deadline=None)
@given(count=st.integers(1, 50), batch=st.integers(1, 80), seed=st.integers(0, 5))
def test_every_row_comes_once_an_epoch(count, batch, seed):
    steps = -(-3 * count // batch)
    drawn = [batch_rows(count, batch, seed, s) for s in range(steps)]
    assert all(rows.shape == (batch,) and rows.dtype == torch.int64 for rows in drawn)
    sequence = torch.cat(drawn)
    for epoch in range(3):
        assert sequence[epoch * count : (epoch + 1) * count].sort().values.tolist() == list(range(count))


def test_a_step_needs_no_step_before_it():
    forward = [batch_rows(37, 8, 5, step) for step in range(30)]
    backward = [batch_rows(37, 8, 5, step) for step in reversed(range(30))][::-1]
    assert all(torch.equal(a, b) for a, b in zip(forward, backward))


def test_order_depends_on_seed_and_epoch():
    first = batch_rows(40, 40, 0, 0)
    assert not torch.equal(first, batch_rows(40, 40, 1, 0))
    assert not torch.equal(first, batch_rows(40, 40, 0, 1))


def test_writing_into_a_batch_does_not_change_the_next():
    batch_rows(16, 16, 9, 0).zero_()
    assert batch_rows(16, 16, 9, 0).sum() == 120


def test_a_batch_larger_than_the_collection_repeats_it():
    assert batch_rows(3, 8, 0, 0).bincount(minlength=3).tolist() in ([3, 3, 2], [3, 2, 3], [2, 3, 3])


def test_nothing_cannot_be_sampled():
    for count, batch in ((0, 4), (4, 0)):
        with pytest.raises(UserError, match="at least one of each"):
            batch_rows(count, batch, 0, 0)


def test_rows_are_spread_within_the_collection():
    for count in (1, 7, 2**24 - 1, 2**24 + 4, 10**8):
        rows = spread_rows(count, 1024)
        assert rows[0] == 0 and rows[-1] == count - 1 and bool((rows.diff() > 0).all())
