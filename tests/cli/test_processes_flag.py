"""How many processes the words of a command ask for."""

from __future__ import annotations

import pytest

from unproject.cli._processes import _count


@pytest.mark.parametrize(
    ("words", "count", "rest"),
    [
        (["toy", "--steps", "2"], None, ["toy", "--steps", "2"]),
        (["--processes", "2", "toy"], 2, ["toy"]),
        (["toy", "--processes=3", "--quiet"], 3, ["toy", "--quiet"]),
        (["--processes", "/dev/zero", "toy", "--processes", "1"], 1, ["toy"]),  # the last counts, as of other flags
        (["--processes=x", "--processes=2"], 2, []),
    ],
)
def test_the_number_and_the_other_words(words: list[str], count: int | None, rest: list[str]) -> None:
    assert _count(words) == (count, rest)
