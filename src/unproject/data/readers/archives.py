"""Members of .npz archives that are mapped into memory: large ones, not compressed, as `np.savez` writes them."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np

MAPPED = 2**24
"""Bytes from which on a member is mapped, which reads nothing and checks no sum; smaller ones are read and checked."""
LOCAL_HEADER, NAME_LENGTHS = 30, slice(26, 30)
"""Bytes of the header in front of a member's name, and where the lengths of the name and of what follows it stand."""


def mapped(path: Path, info: zipfile.ZipInfo) -> np.ndarray | None:
    """Map a large member whose bytes lie in the archive as they are (copy on write: the file stays as it is).

    None if it is to be read: it is small, compressed, holds Python objects or begins at an odd place.

    Raises:
        Exception: of a dozen kinds, for a damaged file.
    """
    if info.compress_type != zipfile.ZIP_STORED or info.flag_bits & 1 or info.file_size < MAPPED:
        return None
    with path.open("rb") as file:
        file.seek(info.header_offset)
        lengths = struct.unpack("<HH", file.read(LOCAL_HEADER)[NAME_LENGTHS])
        file.seek(info.header_offset + LOCAL_HEADER + sum(lengths))
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, by_columns, dtype = read(file)
        if dtype.hasobject or file.tell() % dtype.alignment:
            return None
        return np.memmap(path, dtype, "c", file.tell(), shape, "F" if by_columns else "C")
