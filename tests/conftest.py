"""Random numbers of tests: each fixture and each test starts from the same state of the global generators, in whatever
order and process it runs, so that what fails once fails always."""

from __future__ import annotations

import gc
import random
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import settings

sys.path.append(str(Path(__file__).parent))

from forked import ForkedPython  # noqa: E402

settings.register_profile("same", derandomize=True)
settings.load_profile("same")
gc.disable()  # while thousands of tests are collected, nothing of which is garbage


ESTIMATED = {"test_chain.py", "test_results.py", "test_trust.py"}
"""Modules that test what `train` says of the time and the memory of a step before it begins."""


@pytest.fixture(scope="module", autouse=True)
def few_estimates(request: pytest.FixtureRequest) -> Iterator[None]:
    """The estimate takes a second, which is longer than most toys train."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.name not in ESTIMATED:
            patch.setattr("unproject.cli.train._estimate", lambda recipe, device: None)
        yield


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of this Python that are started are copies of this one."""
    if sys.platform == "linux":
        monkeypatch.setattr("subprocess.Popen", ForkedPython)
        handler = "torch.distributed.elastic.multiprocessing.subprocess_handler.subprocess_handler"
        monkeypatch.setattr(f"{handler}.Popen", ForkedPython)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """What is there by now stays, and is not looked through again and again."""
    gc.freeze()
    gc.enable()


def seed_all() -> None:
    torch.manual_seed(0)
    np.random.seed(0)
    random.seed(0)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_fixture_setup() -> Generator[None, object, object]:
    seed_all()
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    seed_all()
    return (yield)
