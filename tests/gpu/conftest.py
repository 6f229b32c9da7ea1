"""Tests marked `gpu` run where PyTorch finds a CUDA device, and are skipped elsewhere: `pytest -m gpu`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

# Trainings and looks that other tests have.
sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "training")]


@pytest.fixture(autouse=True)
def exact_float32() -> Iterator[None]:
    """Compare in float32: convolutions on a GPU round their inputs to 10 bits otherwise."""
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device is there")
    rounded = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False
    yield
    torch.backends.cudnn.allow_tf32 = rounded
