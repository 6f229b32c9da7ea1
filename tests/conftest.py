"""Random numbers of tests: each fixture and each test starts from the same state of the global generators, in whatever
order and process it runs, so that what fails once fails always."""

from __future__ import annotations

import random
from collections.abc import Generator

import numpy as np
import pytest
import torch
from hypothesis import settings

settings.register_profile("same", derandomize=True)
settings.load_profile("same")


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
