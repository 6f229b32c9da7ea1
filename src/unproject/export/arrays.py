"""NumPy's .npz, with the key that `unproject sample` writes: `volume`, float32 (N, X, Y, Z) in [0, 1]."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from unproject._files import atomic_path
from unproject.export._volumes import Written, as_batch, within


def npz(volumes: ArrayLike, path: str | PathLike[str]) -> Written:
    """The volumes, compressed: at the path if it ends in .npz, else volumes.npz in that folder."""
    batch, final = as_batch(volumes), within(Path(path), ".npz", "volumes.npz")
    with atomic_path(final) as temporary, temporary.open("wb") as stream:  # of a path NumPy changes the suffix .NPZ
        np.savez_compressed(stream, volume=batch)
    return Written((final,))
