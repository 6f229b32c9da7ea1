"""Collections small enough to build every recipe in a moment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unproject.data import chairs


@pytest.fixture(scope="session")
def volumes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six chairs of 16³ voxels."""
    path = tmp_path_factory.mktemp("shapes") / "chairs.npz"
    np.savez(path, volume=chairs(6, 16, seed=0).numpy())
    return path


AZIMUTHS = {"front": 0.0, "wrapped": 355.0, "edge": 11.2, "past": 11.3, "side": 90.0}


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    """Five discs of growing size, without views."""
    for k, name in enumerate(AZIMUTHS):
        rows, columns = np.mgrid[:20, :20] - 9.5
        disc = np.hypot(rows, columns) < 4 + k
        Image.fromarray((255 * disc).astype(np.uint8)).save(tmp_path / f"{name}.png")
    return tmp_path


@pytest.fixture
def known_masks(masks: Path) -> Path:
    """The discs with their azimuths in views.csv."""
    rows = [f"{name}.png,{azimuth}" for name, azimuth in AZIMUTHS.items()]
    (masks / "views.csv").write_text("\n".join(["file,azimuth", *rows]), encoding="utf-8")
    return masks
