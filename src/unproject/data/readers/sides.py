"""Sides: how large the pictures or volumes of a path are, by the headers of its files alone."""

from __future__ import annotations

import gzip
import os
import statistics
import struct
import warnings
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..._files import check_regular, files_with
from .arrays import PICTURES, VOLUMES
from .lines import LINES, SINOGRAMS
from .paths import holds_shapes
from .pictures import SUFFIXES
from .shapes import is_shape_archive, split_selector
from .stored import StoredArrays, header_of

PACK = ("names", "skipped", "side")
"""What a pack says of its files."""
MAX_FILES_OPENED = 256
"""Files of a folder that are opened, spread evenly over it."""


def side_of(path: str | os.PathLike[str]) -> int | None:
    """Return the shorter side of the pictures or volumes of a path: of a folder the median, without decoding them.

    None of what has no size, such as meshes and line integrals, and of what is missing, damaged or of another format:
    its reader says what is wrong with it.

    Examples:
        >>> import numpy as np
        >>> np.save("masks.npy", np.zeros((5, 48, 64), bool))
        >>> side_of("masks.npy")
        48
    """
    path, _ = split_selector(Path(path))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _of_folder(path) if path.is_dir() else _of_file(path)
    except Exception:  # whatever decoders raise at damaged headers: zlib.error, tokenize.TokenError, RuntimeError, ...
        return None


def detectors_of(path: str | os.PathLike[str]) -> int | None:
    """Return how many detectors the lines or sinograms of an .npz have; None of all else, and of what is damaged.

    Examples:
        >>> import numpy as np
        >>> np.savez("scans.npz", sinograms=np.zeros((7, 64, 12)))
        >>> detectors_of("scans.npz")
        64
    """
    try:
        check_regular(Path(path))
        shapes = StoredArrays(Path(path)).shapes
        found = [shapes[key][-2 if key in SINOGRAMS else -1] for key in (*LINES, *SINOGRAMS) if key in shapes]
        return int(found[0]) if len(found) == 1 else None
    except Exception:  # whatever decoders raise at damaged headers, and at what is no .npz
        return None


def picture_count(path: str | os.PathLike[str]) -> int | None:
    """Return how many picture files a folder holds, or held that was packed; None of what is no folder of pictures.

    Examples:
        >>> picture_count("masks.npy") is None
        True
    """
    path = Path(path)
    if path.is_dir():
        return None if holds_shapes(path) else len(files_with(path, SUFFIXES))
    columns = _columns_of_pack(path)
    if columns is None:
        return None
    files = [*columns["names"].tolist(), *columns["skipped"].tolist()]
    return sum(os.fsdecode(file).lower().endswith(SUFFIXES) for file in files)


def is_pack(path: str | os.PathLike[str]) -> bool:
    """Whether a file is what `unproject data pack` wrote, and not damaged.

    Examples:
        >>> import numpy as np
        >>> np.savez("masks.npz", silhouettes=np.zeros((5, 1, 48, 48), bool))
        >>> is_pack("masks.npz")
        False
    """
    try:
        return _columns_of_pack(Path(path)) is not None
    except Exception:  # whatever zipfile and NumPy raise at damaged files
        return False


def _of_folder(path: Path) -> int | None:
    if holds_shapes(path):
        return _median(files_with(path, (".binvox",)), _of_binvox)
    return _median(files_with(path, SUFFIXES), _of_picture)


def _median(files: Sequence[Path], side: Callable[[Path], int | None]) -> int | None:
    count = min(len(files), MAX_FILES_OPENED)
    spread = [files[i * len(files) // count] for i in range(count)]
    sides = [found for found in map(side, spread) if found is not None]
    return int(statistics.median(sides)) if sides else None


def _of_picture(file: Path) -> int | None:
    size = size_of_picture(file)
    return None if size is None else min(size)


def size_of_picture(file: Path) -> tuple[int, int] | None:
    """Return the width and the height of a picture, turned as its camera says; None of what Pillow does not know."""
    from PIL import ExifTags, Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(file) as picture:
                width, height = picture.size
                # The width of a TIFF is that of the turned picture already, but for its own tag.
                turned = getattr(picture, "tag_v2", {}).get(ExifTags.Base.ImageWidth, width) != width
                lying = not turned and picture.getexif().get(ExifTags.Base.Orientation, 1) > 4
                return (height, width) if lying else (width, height)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return None


def _of_binvox(file: Path) -> int | None:
    with file.open("rb") as stream:
        lines = stream.read(1024).partition(b"\ndata\n")[0].split(b"\n")
    sides = [[int(n) for n in line.split()[1:]] for line in lines if line.startswith(b"dim ")]
    return max(sides[0]) if sides and sides[0] else None  # what is no cube is padded to one


def _of_file(path: Path) -> int | None:
    check_regular(path)
    if path.suffix.lower() == ".binvox":
        return _of_binvox(path)
    if path.suffix.lower() == ".npz":
        return _of_npz(path)
    if path.suffix.lower() == ".npy":
        with path.open("rb") as stream:
            return _of_shape(header_of(stream)[0])
    return None if path.suffix.lower() in SUFFIXES else _of_shape(_idx_shape(path))


def _columns_of_pack(path: Path) -> dict[str, np.ndarray] | None:
    """Return what a pack says of its files; None of what is no pack."""
    if path.suffix.lower() != ".npz" or not path.is_file() or not zipfile.is_zipfile(path):
        return None
    arrays = StoredArrays(path)
    return {key: arrays[key] for key in PACK} if {*PACK} <= {*arrays} else None


def _of_npz(path: Path) -> int | None:
    arrays = StoredArrays(path)
    if {*PACK} <= {*arrays}:
        stored = [min(shape[-2:]) for key, shape in arrays.shapes.items() if key in PICTURES]
        return min(int(arrays["side"]), *stored) or None
    if is_shape_archive(path):
        return int(np.atleast_1d(arrays["shape"])[-1])
    shapes = arrays.shapes
    named = [key for key in (*VOLUMES, *PICTURES) if key in shapes]
    found = named or [key for key, shape in shapes.items() if len(shape) in (3, 4) and key not in (*LINES, *SINOGRAMS)]
    return _of_shape(shapes[found[0]]) if len(found) == 1 else None


def _idx_shape(path: Path) -> tuple[int, ...]:
    with path.open("rb") as stream:
        zipped = stream.read(2) == b"\x1f\x8b"
    with gzip.open(path) if zipped else path.open("rb") as stream:
        head = stream.read(4)
        return struct.unpack(f">{head[3]}I", stream.read(4 * head[3])) if head[:3] == b"\0\0\x08" else ()


def _of_shape(shape: tuple[int, ...]) -> int | None:
    """Return the shortest side of (N, H, W), (N, C, H, W), (N, H, W, C), (N, X, Y, Z) or (N, 1, X, Y, Z)."""
    sides = [side for side in shape[1:] if side not in (1, 3, 4)] if len(shape) > 3 else list(shape[1:])
    return min(sides) if len(shape) >= 3 and sides else None
