"""Arrays: .npz and .npy files of pictures or volumes, and idx files (the format of MNIST).

Values are bool, uint8 (shares of 255) or float in [0, 1]. Pictures are (N, H, W), (N, C, H, W) or (N, H, W, C) with
C of 1, 3 or 4; volumes (N, X, Y, Z); line integrals (N, D) or (N, 1, D), named `lines`. Known views may stand beside
them as `azimuth` and `elevation`, or `angle`, (N,) radians.
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

from ..._types import UserError
from ..records import Records
from .framing import AS_GIVEN, Framing, UnusablePicture, frame

VOLUMES = ("volume", "volumes", "voxels")
PICTURES = ("image", "images", "sil", "silhouette", "silhouettes", "mask", "masks")
LINES = ("line", "lines", "line_integrals")
LATENTS = ("azimuth", "elevation", "angle")


def read_arrays(path: Path, size: int | None = None, framing: Framing | None = None, strict: bool = False) -> Records:
    """Pictures (N, 1, H, W), volumes (N, X, Y, Z) or lines (N, 1, D) of an .npz, .npy or idx file.

    Pictures are as given unless a framing is; `size` resamples pictures and volumes by area, and leaves lines alone.

    Raises:
        UserError: naming the file, the key and what to mend.
    """
    arrays = load_arrays(path)
    key = _data_key(path, arrays)
    values = checked_values(arrays[key], f"{path}: {key}")
    latents = _latents(path, arrays, len(values))
    if key in LINES:
        return Records.from_tensor(_lines(path, key, values), latents, source=str(path))
    if key in VOLUMES or (key not in PICTURES and _is_volume(values)):
        return Records.from_tensor(resized_volumes(_volumes(path, key, values), size), latents, source=str(path))
    return _pictures(path, key, values, latents, size, framing or AS_GIVEN, strict)


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """Every array of a file by its key; "array" if there is one without a name. Nothing is ever unpickled.

    Raises:
        UserError: if the file is missing, truncated or holds Python objects.
    """
    try:
        if ".npz" not in path.suffixes and ".npy" not in path.suffixes:
            return {"array": read_idx(path)}
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            return {key: loaded[key] for key in loaded.files} if hasattr(loaded, "files") else {"array": loaded}
    except FileNotFoundError:
        raise UserError(f"{path}: there is no such file; check the path") from None
    except Exception as error:  # a damaged file makes zipfile, zlib and numpy's tokenizer raise a dozen kinds
        raise UserError(f"{path}: {_why(error)}") from None


def _why(error: Exception) -> str:
    if "allow_pickle" in str(error) or "Object arrays" in str(error):
        return "holds Python objects, which are never loaded; save plain arrays of numbers"
    return f"is damaged or of another format ({' '.join(str(error).split())[:120]}); write or fetch it again"


def read_idx(path: Path) -> np.ndarray:
    """An idx file of bytes, gzipped or not: 0 0 8 d, d sizes as big-endian 32-bit integers, the values."""
    raw = path.read_bytes()
    data = gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw
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
    named = [key for key in (*VOLUMES, *PICTURES, *LINES) if key in arrays]
    found = named or [key for key, value in arrays.items() if value.ndim in (3, 4)]
    if len(found) == 1:
        return found[0]
    known = ", ".join((VOLUMES[0], PICTURES[1], PICTURES[3]))
    raise UserError(
        f"{path}: holds {', '.join(f'{k} {v.shape}' for k, v in arrays.items()) or 'nothing'}, of which "
        f"{'several' if found else 'none'} could be the data; save one array (N, H, W) or (N, X, Y, Z) named {known}, "
        f"or (N, D) named {LINES[1]}"
    )


def checked_values(values: np.ndarray, where: str) -> np.ndarray:
    """float32 in [0, 1] of bool, uint8 or float values.

    Raises:
        UserError: if the dtype is another, there is no value, or one is NaN or outside [0, 1].
    """
    if not (values.dtype == bool or values.dtype == np.uint8 or np.issubdtype(values.dtype, np.floating)):
        raise UserError(f"{where}: is of type {values.dtype}; save it as bool, uint8 or float32")
    if values.size == 0:
        raise UserError(f"{where}: is empty {values.shape}; give at least one item")
    scale = 255 if values.dtype == np.uint8 and values.max() > 1 else 1
    values = values.astype(np.float32) / scale
    if not np.isfinite(values).all():
        raise UserError(
            f"{where}: has {int((~np.isfinite(values)).sum())} values that are NaN or infinite; replace them"
        )
    if values.min() < 0 or values.max() > 1:
        raise UserError(f"{where}: values run from {values.min():g} to {values.max():g}; scale them to [0, 1]")
    return values


def _latents(path: Path, arrays: Mapping[str, np.ndarray], count: int) -> dict[str, Tensor] | None:
    found = {name: arrays[name] for name in LATENTS if name in arrays}
    for name, value in found.items():
        if value.shape != (count,) or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            raise UserError(
                f"{path}: {name}: is {value.dtype} {value.shape}; give one finite number of radians for each of {count}"
            )
    return {name: torch.from_numpy(value.astype(np.float32)) for name, value in found.items()} or None


def _is_volume(values: np.ndarray) -> bool:
    return values.ndim == 4 and values.shape[1] not in (1, 3, 4) and values.shape[-1] not in (1, 3, 4)


def _volumes(path: Path, key: str, values: np.ndarray) -> Tensor:
    values = values[:, 0] if values.ndim == 5 and values.shape[1] == 1 else values
    if values.ndim != 4 or len(set(values.shape[1:])) != 1:
        raise UserError(f"{path}: {key}: is of shape {values.shape}; volumes are (N, X, Y, Z) with X = Y = Z")
    return torch.from_numpy(values)


def _lines(path: Path, key: str, values: np.ndarray) -> Tensor:
    values = values[:, None] if values.ndim == 2 else values
    if values.ndim != 3 or values.shape[1] != 1:
        raise UserError(f"{path}: {key}: is of shape {values.shape}; line integrals are (N, D) or (N, 1, D)")
    return torch.from_numpy(values)


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
    if size < now:
        return F.interpolate(volumes[:, None], size=(size,) * 3, mode="area")[:, 0]
    return F.interpolate(volumes[:, None], size=(size,) * 3, mode="trilinear", align_corners=False)[:, 0]


def _pictures(
    path: Path,
    key: str,
    values: np.ndarray,
    latents: dict[str, Tensor] | None,
    size: int | None,
    framing: Framing,
    strict: bool,
) -> Records:
    pictures = _channels_last(path, key, values)
    found = range(len(pictures))
    if framing == AS_GIVEN and (size is None or pictures.shape[1:3] == (size, size)) and pictures.shape[3] == 1:
        images, skipped = torch.from_numpy(np.moveaxis(pictures, 3, 1).copy()), {}
    else:
        images, found, skipped = _framed(path, pictures, size or max(pictures.shape[1:3]), framing, strict)
    whole = Records.from_tensor(values[:, :1], latents, source=str(path)).subset(list(found))
    return Records.from_tensor(images, whole.latents, whole.names, tuple(skipped.items()), str(path))


def _channels_last(path: Path, key: str, values: np.ndarray) -> np.ndarray:
    """(N, H, W, C) of (N, H, W), (N, C, H, W) or (N, H, W, C)."""
    if values.ndim == 3:
        return values[..., None]
    if values.ndim == 4 and values.shape[1] in (1, 3, 4):
        return np.moveaxis(values, 1, 3)
    if values.ndim == 4 and values.shape[3] in (1, 3, 4):
        return values
    raise UserError(f"{path}: {key}: is of shape {values.shape}; pictures are (N, H, W), (N, C, H, W) or (N, H, W, C)")


def _framed(
    path: Path, pictures: np.ndarray, size: int, framing: Framing, strict: bool
) -> tuple[Tensor, list[int], dict[str, str]]:
    images, skipped = {}, {}
    for row, picture in enumerate(pictures):
        try:
            images[row] = frame(picture, size, framing).image
        except UnusablePicture as reason:
            if strict:
                raise UserError(f"{path}, item {row}: {reason}; mend or remove it, or leave out --strict") from None
            skipped[f"{row:05d}"] = str(reason)
    if not images:
        raise UserError(f"{path}: none of the {len(pictures)} pictures can be used (item 0: {skipped['00000']})")
    return torch.stack(list(images.values())), list(images), skipped
