"""A slow step that is asked to stop is left in its middle; the run goes on as if it had never been."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from comparing import differences
from toy import toy

from unproject.training import Recipe, checkpoint, resume, train
from unproject.training.trainer import Trainer

PARTS = ("_project", "_update_discriminators", "_update_generator")


@contextmanager
def interrupting(part: str, when: int, slow: float = 10.0) -> Iterator[None]:
    """Ask to stop when a part of a step begins for the n-th time; steps of over `slow` seconds count as slow."""
    own, calls = getattr(Trainer, part), iter(range(1, 1000))

    def asked(self: Trainer, *arguments: Any) -> Any:
        if next(calls) == when:
            signal.raise_signal(signal.SIGTERM)
        return own(self, *arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trainer, part, asked)
        patch.setattr("unproject.training.trainer.SLOW", slow)
        yield


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("views", ["known", "predicted", "learned"])
def test_half_a_step_is_undone(part: str, views: Any, tmp_path: Path) -> None:
    recipe = toy(views=views, steps=6, seed=1)
    train(recipe, tmp_path / "whole", quiet=True)
    with interrupting(part, 4, slow=-1.0):
        assert train(recipe, tmp_path / "halves", quiet=True).step == 3
    resume(tmp_path / "halves", recipe, quiet=True)
    assert differences(tmp_path / "whole", tmp_path / "halves") == []


def test_the_first_step_may_be_long(tmp_path: Path) -> None:
    """Nothing is saved of it, and resuming starts again."""
    recipe: Recipe = toy(views="predicted", steps=4)
    train(recipe, tmp_path / "whole", quiet=True)
    with interrupting("_update_generator", 1):
        assert train(recipe, tmp_path / "halves", quiet=True).step == 0
    assert checkpoint.list_checkpoints(tmp_path / "halves" / "checkpoints") == []
    resume(tmp_path / "halves", recipe, quiet=True)
    assert differences(tmp_path / "whole", tmp_path / "halves") == []


def test_a_quick_step_is_finished(tmp_path: Path) -> None:
    with interrupting("_update_discriminators", 3):
        assert train(toy(views="known", steps=6), tmp_path / "run", quiet=True).step == 3
