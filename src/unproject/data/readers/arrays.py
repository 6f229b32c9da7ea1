"""Arrays: .npz and .npy files of pictures or volumes, and idx files (the format of MNIST).

Values are bool, uint8 (shares of 255) or float in [0, 1]. Pictures are (N, H, W), (N, C, H, W) or (N, H, W, C) with
C of 1, 3 or 4; volumes (N, X, Y, Z). Line integrals, in any unit and of any type of number, are (N, D) or (N, 1, D),
named `lines`, or sinograms (M, D, A), named `sinograms`. Known views may stand beside them as `azimuth` and
`elevation`, or `angle`, (N,) or (A,), in radians, or in degrees if one is beyond 4 π (other spellings: `LATENTS`);
so may `names` (N,) of items, and what was left out as `skipped` and `reasons` (M,). A .npy file, and what is large in
an .npz that is not compressed, is mapped into memory, not read; pictures of it are resampled by the batch. Floats of 64
or 16 bits are made float32 first, in memory.
"""

from __future__ import annotations

import gzip
import math
import struct
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..._files import check_regular, check_unpacked
from ..._pictures import LONGEST
from ..._types import UserError
from ..lazy import Lazy
from .array_masks import are_inverted, checked_masks, masks_of, shown_rows, warn_of_axes, warn_of_inversion
from .array_volumes import cubes, occupied
from .found import Found, chunks, to_bytes, to_floats, white_of
from .framing import AS_GIVEN, frame
from .images import as_images
from .latents import known_latents, latents_of
from .lines import LINES, SINOGRAMS, count_of_angles, lines_of
from .options import ReadOptions
from .stored import StoredArrays, shapes_of, why_unreadable

VOLUMES = ("volume", "volumes", "voxels")
PICTURES = ("image", "images", "sil", "silhouette", "silhouettes", "mask", "masks")
BESIDE = ("names", "skipped", "reasons", "side")
"""What may stand beside them, besides known views."""


def read_arrays(path: Path, options: ReadOptions) -> Found:
    """Read pictures (N, C, H, W), volumes (N, X, Y, Z) or lines (N, 1, D) of an .npz, .npy or idx file.

    Silhouettes are as they are unless a framing is given; a size resamples pictures and volumes, not lines.

    Raises:
        UserError: naming the file, the key and what to fix.
    """
    arrays = load_arrays(path)
    key = _data_key(path, shapes_of(arrays))
    measured = key in (*LINES, *SINOGRAMS)
    stored = arrays[key]
    of_any_size = measured or (options.images and options.unbounded)
    values = checked_values(stored, f"{path}: {key}", of_pictures=not of_any_size)
    latents = latents_of(path, arrays, count_of_angles(key, values), values.shape, measured, options.latents)
    if measured:
        return lines_of(path, key, values, latents, _texts(arrays, "names"))
    found = Found(values, _names(arrays, len(values)), latents, _skipped(arrays), str(path))
    if key in VOLUMES or (key not in PICTURES and _is_volume(values)):
        return occupied(found._replace(items=cubes(path, key, values)), options.size, options.strict)
    pictures = _channels_first(path, key, values)
    warn_of_axes(path, key, tuple(values.shape))
    if not options.images:
        pictures = checked_masks(path, key, pictures)
    if isinstance(stored, np.memmap):
        return _in_file(path, key, found, pictures, options)
    if options.images:
        return found._replace(items=as_images(_of_eight_bits(pictures), options.size, options.colour), white=EIGHT_BITS)
    return masks_of(path, key, found, pictures, options)


def unread_arrays(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the arrays of an .npz that `read_arrays` leaves, by their keys; none of other files.

    Examples:
        >>> np.savez("scans.npz", lines=np.zeros((5, 8)), angle=np.zeros(5), dose=np.zeros((5, 2)))
        >>> unread_arrays(Path("scans.npz"))
        {'dose': (5, 2)}
    """
    if path.suffix.lower() != ".npz" or not path.is_file() or not zipfile.is_zipfile(path):
        return {}
    shapes = shapes_of(load_arrays(path))
    key = _data_key(path, shapes)
    used = {key, *BESIDE, *known_latents(shapes, key in (*LINES, *SINOGRAMS))}
    return {name: shape for name, shape in shapes.items() if name not in used}


def load_arrays(path: Path) -> Mapping[str, np.ndarray]:
    """Return the arrays of a file by their keys, "array" if there is one without a name. Nothing is ever unpickled.

    Those of an .npz are read when they are asked for.

    Raises:
        UserError: if the file is missing, a folder or truncated, holds Python objects, or announces more than it holds.
    """
    check_regular(path)
    if path.is_dir():
        raise UserError(f"{path}: is a folder; name a file of arrays in it")
    try:
        suffixes = {suffix.lower() for suffix in path.suffixes}
        if not suffixes & {".npz", ".npy"}:
            return {"array": read_idx(path)}
        if ".npz" in suffixes and zipfile.is_zipfile(path):
            return StoredArrays(path)
        # Copy on write: torch takes only arrays that can be written to, and the file stays as it is.
        return {"array": np.lib.format.open_memmap(path, mode="c")}
    except UserError:
        raise
    except Exception as error:  # a damaged file makes zipfile, zlib and numpy's tokenizer raise a dozen kinds
        raise UserError(f"{path}: {why_unreadable(error)}") from None


def read_idx(path: Path) -> np.ndarray:
    """Read an idx file of bytes, gzipped or not: 0 0 8 d, d sizes as big-endian 32-bit integers, the values."""
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    with gzip.open(path) if packed else path.open("rb") as stream:
        head = stream.read(4)
        if head[:3] != b"\0\0\x08" or len(head) < 4:
            raise ValueError("neither .npz, .npy nor an idx file of bytes")
        shape = struct.unpack(f">{head[3]}I", stream.read(4 * head[3]))
        check_unpacked(path, math.prod(shape))
        values = _up_to(math.prod(shape) + 1, stream)
    if len(values) != math.prod(shape):
        held = f"{len(values)}" if len(values) < math.prod(shape) else "more"
        raise ValueError(f"announces {' x '.join(map(str, shape))} values and holds {held}")
    return np.frombuffer(values, np.uint8).reshape(shape)


def _up_to(count: int, stream: Any) -> bytearray:
    """So many bytes at most, of a stream that may be endless; in an array that can be written to, for torch."""
    values = bytearray()
    while len(values) < count and (part := stream.read(min(2**20, count - len(values)))):
        values += part
    return values


def _data_key(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> str:
    """The key of the pictures or volumes: one of the known names, else the only array of 3 or 4 axes."""
    named = [key for key in (*VOLUMES, *PICTURES, *LINES, *SINOGRAMS) if key in shapes]
    found = named or [key for key, shape in shapes.items() if len(shape) in (3, 4)]
    if len(found) == 1:
        return found[0]
    known = ", ".join((VOLUMES[0], PICTURES[1], PICTURES[3]))
    raise UserError(
        f"{path}: holds {', '.join(f'{k} {v}' for k, v in shapes.items()) or 'nothing'}, of which "
        f"{'several' if found else 'none'} could be the data; save one array (N, H, W) or (N, X, Y, Z) named {known}, "
        f"(N, D) named {LINES[1]} or (M, D, A) named {SINOGRAMS[1]}"
    )


def checked_values(values: np.ndarray, where: str, of_pictures: bool = True) -> Tensor:
    """uint8 of bool or uint8 values and float32 of others, without a copy where it needs none.

    Raises:
        UserError: if there is no value, or one that is NaN; of pictures and volumes, if the dtype is another, or a
            float is outside [0, 1].
    """
    if values.dtype.kind not in ("f" if of_pictures else "fiu") and values.dtype not in (bool, np.uint8):
        raise UserError(f"{where}: is of type {values.dtype}; save it as bool, uint8 or float32")
    if values.size == 0 or values.ndim == 0:
        raise UserError(f"{where}: is empty {values.shape}; give at least one item")
    if values.dtype in (bool, np.uint8):
        return torch.from_numpy(values.view(np.uint8))
    kept = torch.from_numpy(values.astype(np.float32, copy=False))
    bad = torch.cat([(~torch.isfinite(part)).reshape(len(part), -1).sum(1) for part in chunks(kept)])
    if bad.any():
        rows = bad.nonzero()[:, 0]
        raise UserError(
            f"{where}: has {int(bad.sum())} values that are NaN or infinite, in {len(rows)} of {len(bad)} rows (row "
            f"{int(rows[0])} is the first); leave these rows out, or replace the values"
        )
    low, high = float(kept.min()), float(kept.max())
    if of_pictures and (low < 0 or high > 1):
        raise UserError(
            f"{where}: values run from {low:g} to {high:g}; scale pictures and volumes to [0, 1]; line integrals of "
            "any unit lie in an .npz, as `sinograms` (M, D, A) or `lines` (N, D)"
        )
    return kept


def _names(arrays: Mapping[str, np.ndarray], count: int) -> Sequence[str] | None:
    """The names of the items, if there is one for each."""
    names = _texts(arrays, "names")
    return names if len(names) == count else None


def _skipped(arrays: Mapping[str, np.ndarray]) -> list[tuple[str, str]]:
    return list(zip(_texts(arrays, "skipped"), _texts(arrays, "reasons"), strict=False))


def _texts(arrays: Mapping[str, np.ndarray], key: str) -> list[str]:
    found = arrays.get(key)
    if found is None or found.ndim != 1 or found.dtype.kind not in "SU":
        return []
    return (
        [text.decode(errors="backslashreplace") for text in found.tolist()]
        if found.dtype.kind == "S"
        else found.tolist()
    )


def _is_volume(values: Tensor) -> bool:
    return values.ndim == 4 and values.shape[1] not in (1, 3, 4) and values.shape[-1] not in (1, 3, 4)


def _channels_first(path: Path, key: str, values: Tensor) -> Tensor:
    """(N, C, H, W) of (N, H, W), (N, C, H, W) or (N, H, W, C)."""
    if max(values.shape[1:], default=0) > LONGEST:
        raise UserError(f"{path}: {key}: is of shape {tuple(values.shape)}; a side has at most {LONGEST} pixels")
    if values.ndim == 3:
        return values[:, None]
    if values.ndim == 4 and values.shape[1] in (1, 3, 4):
        return values
    if values.ndim == 4 and values.shape[3] in (1, 3, 4):
        return values.movedim(3, 1)
    raise UserError(
        f"{path}: {key}: is of shape {tuple(values.shape)}; pictures are (N, H, W), (N, C, H, W) or (N, H, W, C), C of "
        "1, 3 or 4; in Python up.Collection(tensor) takes any"
    )


EIGHT_BITS = 255
LARGEST_SEARCHED = 2**28
"""Bytes of an array in a file up to which all its masks are read to leave out those that show nothing."""


def _of_eight_bits(pictures: Tensor) -> Tensor:
    """Pictures in which 255 stands for 1, whatever did before: what is made of them is grey; floats as they are."""
    return pictures * EIGHT_BITS if pictures.dtype == torch.uint8 and white_of(pictures) == 1 else pictures


def _in_file(path: Path, key: str, found: Found, pictures: Tensor, options: ReadOptions) -> Found:
    """Pictures that stay in their file: what `as_images` and `_silhouettes` make of them is made by the batch."""
    white, framing = white_of(pictures), options.framing or AS_GIVEN
    if options.images:
        factor = EIGHT_BITS if white == 1 and not pictures.is_floating_point() else 1

        def grey(some: Tensor) -> Tensor:
            return as_images(some * factor, options.size, options.colour)

        return found._replace(items=Lazy(pictures, change=grey), white=EIGHT_BITS)
    if framing != AS_GIVEN:  # some may have to be skipped
        return masks_of(path, key, found, pictures, options)
    inverted = pictures.shape[1] == 1 and are_inverted(pictures, white)
    if inverted:
        warn_of_inversion(path, key)
    rows = None
    if pictures.nbytes < LARGEST_SEARCHED:
        found, rows = shown_rows(path, key, found, pictures, options.strict, inverted)
    size = options.size or max(pictures.shape[2:])
    if pictures.shape[1] == 1 and (options.size is None or pictures.shape[2:] == (size, size)):
        items = Lazy(pictures, rows, (lambda some: white - some) if inverted else None)
        return found._replace(items=items, white=white)
    eight_bits = not pictures.is_floating_point()

    def resampled(some: Tensor) -> Tensor:
        some = white - some if inverted else some
        images = torch.stack([frame(x.movedim(0, 2).numpy(), size, AS_GIVEN).image for x in to_floats(some, white)])
        return to_bytes(images) if eight_bits else images

    return found._replace(items=Lazy(pictures, rows, resampled), white=255 if eight_bits else 1)
