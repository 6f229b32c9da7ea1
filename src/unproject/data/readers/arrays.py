"""Arrays: .npz and .npy files of pictures or volumes, and idx files (the format of MNIST).

Values are bool, uint8 (shares of 255) or float in [0, 1]. Pictures are (N, H, W), (N, C, H, W) or (N, H, W, C) with
C of 1, 3 or 4; volumes (N, X, Y, Z). Line integrals, in any unit and of any type of number, are (N, D) or (N, 1, D),
named `lines`, or sinograms (M, D, A), named `sinograms`. Known views may stand beside them as `azimuth` and
`elevation`, or `angle`, (N,) or (A,), in radians, or in degrees if one is beyond 4 π. A .npy file is mapped into
memory, not read.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..._pictures import UnusablePicture
from ..._types import UserError
from .found import Found, chunks, to_bytes, to_floats, white_of
from .framing import AS_GIVEN, frame
from .how import How
from .images import as_images
from .lines import LINES, SINOGRAMS, count_of_angles, in_radians, lines_of

VOLUMES = ("volume", "volumes", "voxels")
PICTURES = ("image", "images", "sil", "silhouette", "silhouettes", "mask", "masks")
LATENTS = ("azimuth", "elevation", "angle")


def read_arrays(path: Path, how: How) -> Found:
    """Read pictures (N, C, H, W), volumes (N, X, Y, Z) or lines (N, 1, D) of an .npz, .npy or idx file.

    Silhouettes are as they are unless a framing is given; a size resamples pictures and volumes, not lines.

    Raises:
        UserError: naming the file, the key and what to fix.
    """
    arrays = load_arrays(path)
    key = _data_key(path, arrays)
    measured = key in (*LINES, *SINOGRAMS)
    values = checked_values(arrays[key], f"{path}: {key}", of_pictures=not measured)
    latents = _latents(path, arrays, count_of_angles(key, values))
    if measured:
        return lines_of(path, key, values, latents)
    found = Found(values, latents=latents, source=str(path))
    if key in VOLUMES or (key not in PICTURES and _is_volume(values)):
        return found._replace(items=resized_volumes(_volumes(path, key, values), how.size))
    pictures = _channels_first(path, key, values)
    if how.images:
        return found._replace(items=as_images(pictures, how.size, how.colour), white=white_of(values))
    return _silhouettes(path, found, pictures, how)


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """Load every array of a file by its key; "array" if there is one without a name. Nothing is ever unpickled.

    Raises:
        UserError: if the file is missing, truncated or holds Python objects.
    """
    try:
        if ".npz" not in path.suffixes and ".npy" not in path.suffixes:
            return {"array": read_idx(path)}
        if ".npz" not in path.suffixes:
            # Copy on write: torch takes only arrays that can be written to, and the file stays as it is.
            return {"array": np.load(path, mmap_mode="c", allow_pickle=False)}
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            return {key: loaded[key] for key in loaded.files} if hasattr(loaded, "files") else {"array": loaded}
    except FileNotFoundError:
        raise UserError(f"{path}: there is no such file; check the path") from None
    except Exception as error:  # a damaged file makes zipfile, zlib and numpy's tokenizer raise a dozen kinds
        raise UserError(f"{path}: {_why(error)}") from None


def _why(error: Exception) -> str:
    if any(words in str(error) for words in ("allow_pickle", "Object arrays", "Python objects")):
        return "holds Python objects, which are never loaded; save plain arrays of numbers"
    return f"is damaged or of another format ({' '.join(str(error).split())[:120]}); write or fetch it again"


def read_idx(path: Path) -> np.ndarray:
    """Read an idx file of bytes, gzipped or not: 0 0 8 d, d sizes as big-endian 32-bit integers, the values."""
    raw = path.read_bytes()
    data = bytearray(gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw)  # one that can be written to, for torch
    if data[:3] != b"\x00\x00\x08" or len(data) < 4:
        raise ValueError("neither .npz, .npy nor an idx file of bytes")
    dims = data[3]
    shape = np.frombuffer(data, ">u4", dims, 4).astype(int)
    values = np.frombuffer(data, np.uint8, -1, 4 + 4 * dims)
    if values.size != math.prod(shape.tolist()):
        raise ValueError(f"announces {' x '.join(map(str, shape))} values and holds {values.size}")
    return values.reshape(shape)


def _data_key(path: Path, arrays: Mapping[str, np.ndarray]) -> str:
    """The key of the pictures or volumes: one of the known names, else the only array of 3 or 4 axes."""
    named = [key for key in (*VOLUMES, *PICTURES, *LINES, *SINOGRAMS) if key in arrays]
    found = named or [key for key, value in arrays.items() if value.ndim in (3, 4)]
    if len(found) == 1:
        return found[0]
    known = ", ".join((VOLUMES[0], PICTURES[1], PICTURES[3]))
    raise UserError(
        f"{path}: holds {', '.join(f'{k} {v.shape}' for k, v in arrays.items()) or 'nothing'}, of which "
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
    bad = sum(int((~torch.isfinite(part)).sum()) for part in chunks(kept))
    if bad:
        raise UserError(f"{where}: has {bad} values that are NaN or infinite; replace them")
    low, high = float(kept.min()), float(kept.max())
    if of_pictures and (low < 0 or high > 1):
        raise UserError(f"{where}: values run from {low:g} to {high:g}; scale them to [0, 1]")
    return kept


def _latents(path: Path, arrays: Mapping[str, np.ndarray], count: int) -> dict[str, Tensor] | None:
    found = {name: arrays[name] for name in LATENTS if name in arrays}
    for name, value in found.items():
        if value.shape != (count,) or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            raise UserError(
                f"{path}: {name}: is {value.dtype} {value.shape}; give one finite number of radians for each of {count}"
            )
    return in_radians(path, found) or None


def _is_volume(values: Tensor) -> bool:
    return values.ndim == 4 and values.shape[1] not in (1, 3, 4) and values.shape[-1] not in (1, 3, 4)


def _volumes(path: Path, key: str, values: Tensor) -> Tensor:
    values = values[:, 0] if values.ndim == 5 and values.shape[1] == 1 else values
    if values.ndim != 4 or len(set(values.shape[1:])) != 1:
        raise UserError(f"{path}: {key}: is of shape {tuple(values.shape)}; volumes are (N, X, Y, Z) with X = Y = Z")
    return values


def resized_volumes(volumes: Tensor, size: int | None) -> Tensor:
    """Volumes (N, X, X, X) at (N, size, size, size).

    A grid smaller by at most an eighth is padded with empty voxels, which keeps every voxel as it is (30 to 32);
    otherwise values are area averages when it shrinks, trilinear when it grows.
    """
    now = volumes.shape[-1]
    if size is None or now == size:
        return volumes
    if now < size <= now * 9 / 8:
        before = (size - now) // 2
        return F.pad(volumes, (before, size - now - before) * 3)
    values = to_floats(volumes, white_of(volumes))[:, None]
    if size < now:
        return F.interpolate(values, size=(size,) * 3, mode="area")[:, 0]
    return F.interpolate(values, size=(size,) * 3, mode="trilinear", align_corners=False)[:, 0]


def _channels_first(path: Path, key: str, values: Tensor) -> Tensor:
    """(N, C, H, W) of (N, H, W), (N, C, H, W) or (N, H, W, C)."""
    if values.ndim == 3:
        return values[:, None]
    if values.ndim == 4 and values.shape[1] in (1, 3, 4):
        return values
    if values.ndim == 4 and values.shape[3] in (1, 3, 4):
        return values.movedim(3, 1)
    raise UserError(
        f"{path}: {key}: is of shape {tuple(values.shape)}; pictures are (N, H, W), (N, C, H, W) or (N, H, W, C)"
    )


def _silhouettes(path: Path, found: Found, pictures: Tensor, how: How) -> Found:
    framing, (channels, *sides) = how.framing or AS_GIVEN, pictures.shape[1:]
    if framing == AS_GIVEN and channels == 1 and (how.size is None or sides == [how.size] * 2):
        return found._replace(items=pictures)
    return _framed(path, found, pictures, How(how.size or max(sides), framing=framing, strict=how.strict))


def _framed(path: Path, found: Found, pictures: Tensor, how: How) -> Found:
    """The pictures that can be framed, in 8 bits unless they are floats whose values are kept."""
    assert how.size is not None and how.framing is not None
    images, skipped, white = {}, {}, white_of(pictures)
    for row, picture in enumerate(pictures):
        try:
            images[row] = frame(to_floats(picture, white).movedim(0, 2).numpy(), how.size, how.framing).image
        except UnusablePicture as reason:
            if how.strict:
                raise UserError(f"{path}, item {row}: {reason}; fix or remove it, or leave out --strict") from None
            skipped[f"{row:05d}"] = str(reason)
    if not images:
        raise UserError(f"{path}: none of the {len(pictures)} pictures can be used (item 0: {skipped['00000']})")
    items = torch.stack([*images.values()])
    exact = pictures.is_floating_point() and how.framing.threshold is None
    rows = list(images)
    return Found(
        items if exact else to_bytes(items),
        [f"{row:05d}" for row in rows],
        None if found.latents is None else {name: value[rows] for name, value in found.latents.items()},
        tuple(skipped.items()),
        str(path),
        1 if exact else 255,
    )
