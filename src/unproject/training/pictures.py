"""What a generator makes right now, as one picture."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from ..export import contact_sheet
from ..networks import Generator

SHOWN = 6


def save_samples(generator: Generator, path: Path) -> None:
    """A contact sheet of the same six codes at every call, so that pictures of a run can be compared."""
    x: Tensor = generator.sample(SHOWN, seed=0, batch=SHOWN)
    contact_sheet(x, path, size=96)
