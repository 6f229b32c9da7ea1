"""Training is tested on one thread: the promise of equal bits is made for one device, and toys need no more."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

# Recipes for tests stand in a file beside them, as a user's would.
sys.path.append(str(Path(__file__).parent))


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def log_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line every second step: toys train for a dozen."""
    monkeypatch.setattr("unproject.training.trainer.EVERY", 2)


@pytest.fixture(autouse=True, scope="module")
def small_previews() -> Iterator[None]:
    """Samples of networks that learned nothing are noise, whose surfaces take longer to draw than toys to train."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("unproject.domains.Volumes.previewed", 1)
        yield
