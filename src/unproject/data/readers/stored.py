"""Arrays of an .npz by their names: each is read, or mapped, when it is asked for, and its shape is known before.

What an array takes in memory is announced by its header, of which a damaged or hostile file says anything: it is
compared with the size of the file first (`check_unpacked`). Nothing is ever unpickled.
"""

from __future__ import annotations

import io
import math
import sys
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..._files import check_unpacked
from ..._types import UserError
from .archives import mapped

HEADER = 2**16
"""Bytes at the beginning of an array among which its header is; NumPy takes none of over 10,000."""


class StoredArrays(Mapping[str, np.ndarray]):
    """The arrays of an .npz.

    Attributes:
        shapes: name → shape.

    Raises:
        UserError: of an array that is too large for its file, when it is asked for. What zipfile, zlib and NumPy raise
            of damaged files passes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.shapes: dict[str, tuple[int, ...]] = {}
        self._bytes: dict[str, int] = {}
        with zipfile.ZipFile(path) as archive:
            for member in archive.namelist():
                if member.endswith(".npy"):
                    with archive.open(member) as stream:
                        shape, kind = header_of(stream)
                    name = member.removesuffix(".npy")
                    self.shapes[name], self._bytes[name] = shape, math.prod(shape) * kind.itemsize

    def __getitem__(self, name: str) -> np.ndarray:
        check_unpacked(self.path, self._bytes[name])
        try:
            with zipfile.ZipFile(self.path) as archive:
                whole = mapped(self.path, archive.getinfo(f"{name}.npy"))
                if whole is not None:
                    return whole
                with archive.open(f"{name}.npy") as stream:
                    return _readable(np.lib.format.read_array(stream, allow_pickle=False))
        except Exception as error:  # see `load_arrays`
            raise UserError(f"{self.path}: {name}: {why_unreadable(error)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.shapes)

    def __len__(self) -> int:
        return len(self.shapes)


def _readable(array: np.ndarray) -> np.ndarray:
    """Refuse text whose characters are none: Python makes strings of them that crash whatever prints them."""
    if array.dtype.kind == "U" and array.size and array.itemsize:
        points = np.ascontiguousarray(array).reshape(-1).view(np.dtype("u4").newbyteorder(array.dtype.byteorder))
        if points.max() > sys.maxunicode:
            raise ValueError("holds characters that are none")
    return array


def header_of(stream: Any) -> tuple[tuple[int, ...], np.dtype]:
    """Return the shape and the type that the header of an array announces, without reading on."""
    head = io.BytesIO(stream.read(HEADER))
    version = np.lib.format.read_magic(head)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(head)
    if min(shape, default=0) < 0:
        raise ValueError(f"announces the shape {shape}")
    return shape, kind


def why_unreadable(error: Exception) -> str:
    """Return what is wrong with a file of arrays, and what to do, of whatever its reader raised."""
    if isinstance(error, UserError):
        return str(error)
    if any(words in str(error) for words in ("allow_pickle", "Object arrays", "Python objects")):
        return "holds Python objects, which are never loaded; save plain arrays of numbers"
    return f"is damaged or of another format ({' '.join(str(error).split())[:120]}); write or fetch it again"


def shapes_of(arrays: Mapping[str, np.ndarray]) -> Mapping[str, tuple[int, ...]]:
    """Return name → shape, without reading what is stored."""
    return arrays.shapes if isinstance(arrays, StoredArrays) else {name: value.shape for name, value in arrays.items()}
