"""3-D collections: voxels (.npz, .binvox), meshes (.obj .stl .ply .glb .off) and folders of them, as volumes.

Volumes are indexed [x, y, z] with y up. A collection whose z is up is turned: (x, y, z) becomes (x, z, -y), a proper
rotation. Packed archives (`X_train`, `X_test`: bits packed along axis 1; `shape`, `class_names`, `y_train`, `y_test`)
have z up by default; `archive.npz:chair` selects a class, `archive.npz:chair/test` its test part.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from ..._files import check_regular, check_unpacked, files_with
from ..._types import UserError
from .array_volumes import EMPTY, occupied, resized_volumes
from .arrays import checked_values, load_arrays, read_arrays
from .found import Found, to_floats, white_of
from .options import ReadOptions
from .stored import shapes_of
from .voxelise import normalised, triangles_of, voxelise

UpAxis = Literal["y", "z"]

MESHES = (".obj", ".stl", ".ply", ".glb", ".gltf", ".off")
SUFFIXES = (".binvox", *MESHES)


def find_volumes(
    path: Path,
    size: int | None = None,
    *,
    up_axis: UpAxis | None = None,
    classes: tuple[str, ...] = (),
    split: str | None = None,
    strict: bool = False,
) -> Found:
    """Read the volumes of a file or folder (see `Collection.volumes`); meshes and packed archives are 32 by default.

    Raises:
        UserError: if nothing there can be used.
    """
    path, selector = split_selector(path)
    if (selector or classes or split) and path.exists() and not _has_classes(path):
        raise UserError(f"{path}: holds no classes to choose from, nor training and test parts; leave the choice out")
    if path.is_dir():
        files = files_with(path, SUFFIXES)
    elif path.suffix.lower() in SUFFIXES:
        files = [path]
    else:
        return _read_archive(path, selector, size, up_axis, classes, split, strict)
    return _read_files(path, files, size, up_axis or "y", strict)


def split_selector(path: Path) -> tuple[Path, str]:
    """`archive.npz:chair/test` as (archive.npz, "chair/test")."""
    head, mark, selector = str(path).partition(".npz:")
    return (Path(head + ".npz"), selector) if mark and not path.exists() else (path, "")


def is_shape_archive(path: Path) -> bool:
    """Whether a file is an .npz of packed bits, recognised by the names of its arrays."""
    if not path.is_file() or not zipfile.is_zipfile(path):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
    except Exception:  # its end looks right and its directory does not; the reader of arrays will say so
        return False
    return "shape.npy" in names and bool(names & {"X_train.npy", "X_test.npy", "volume.npy", "voxels.npy"})


def _has_classes(path: Path) -> bool:
    """Whether a file is an archive of training and test parts, as those of packed bits are but for lone volumes."""
    return is_shape_archive(path) and any(name.startswith("X_") for name in shapes_of(load_arrays(path)))


def turned_up(volumes: Tensor, up_axis: UpAxis) -> Tensor:
    """Volumes (N, X, Y, Z) with y up: from z up, (x, y, z) becomes (x, z, -y)."""
    if up_axis not in ("y", "z"):
        raise UserError(f"up_axis is y or z, not {up_axis!r}")
    return volumes.permute(0, 1, 3, 2).flip(3) if up_axis == "z" else volumes


def _read_archive(
    path: Path,
    selector: str,
    resolution: int | None,
    up_axis: UpAxis | None,
    classes: tuple[str, ...],
    split: str | None,
    strict: bool,
) -> Found:
    if not path.exists():
        raise UserError(f"{path}: there is no such file or folder; check the path")
    if not is_shape_archive(path):
        return _read_plain(path, resolution, up_axis or "y", strict)
    arrays = load_arrays(path)
    if "volume" in arrays or "voxels" in arrays:
        volumes = _unpacked(path, arrays["volume" if "volume" in arrays else "voxels"], arrays["shape"])
        names, up = None, up_axis or "y"
    else:
        wanted, _, part = selector.partition("/")
        chosen = classes or ((wanted,) if wanted else ())
        volumes, names = _selected(path, arrays, chosen, split or part or "train")
        up, resolution = up_axis or "z", resolution or 32
    found = Found(turned_up(volumes, up), names, source=f"{path}{':' * bool(selector)}{selector}")
    return occupied(found, resolution, strict)


def _read_plain(path: Path, resolution: int | None, up_axis: UpAxis, strict: bool) -> Found:
    found = read_arrays(path, ReadOptions(resolution, strict=strict))
    if found.items.shape[1] != found.items.shape[-1]:
        raise UserError(f"{path}: holds no volumes; save them as volume (N, X, Y, Z)")
    return found._replace(items=turned_up(found.whole, up_axis))


def _selected(
    path: Path, arrays: Mapping[str, np.ndarray], classes: tuple[str, ...], split: str
) -> tuple[Tensor, tuple[str, ...]]:
    """The volumes of some classes of one split and their names, `class_row`."""
    if f"X_{split}" not in arrays:
        splits = ", ".join(name[2:] for name in arrays if name.startswith("X_"))
        raise UserError(f"{path}: has no split {split!r}; it has {splits}")
    known = [str(name) for name in np.atleast_1d(arrays.get("class_names", np.array([]))).ravel()]
    labels = _labels(path, arrays, split, known)
    there = [known[k] for k in np.unique(labels) if known]
    for name in classes:
        if name not in there:
            raise UserError(f"{path}: has no class {name!r}; it has {', '.join(there)}")
    wanted = [known.index(name) for name in classes]
    rows = np.flatnonzero(np.isin(labels, wanted)) if classes else np.arange(len(labels))
    volumes = _unpacked(path, arrays[f"X_{split}"][rows], arrays["shape"])
    return volumes, tuple(f"{known[labels[r]] if known else 'shape'}_{r:05d}" for r in rows)


def _labels(path: Path, arrays: Mapping[str, np.ndarray], split: str, known: list[str]) -> np.ndarray:
    """The class of each shape of a split: (N,) places in `class_names`."""
    count = (*shapes_of(arrays)[f"X_{split}"], 0)[0]
    labels = arrays.get(f"y_{split}", np.zeros(count, dtype=np.int64))
    fits = labels.shape == (count,) and labels.dtype.kind in "iu" and (labels >= 0).all()
    if not fits or (known and not (labels < len(known)).all()):
        raise UserError(
            f"{path}: y_{split} is {labels.dtype} {labels.shape}; give each of {count} shapes the place of its class "
            f"among the {len(known)} class_names"
        )
    return labels.astype(np.int64)


def _unpacked(path: Path, bits: np.ndarray, shape: np.ndarray) -> Tensor:
    if bits.ndim == 4:
        return checked_values(bits, str(path))
    sides = [int(n) for n in np.atleast_1d(shape).ravel()[-3:]] if shape.dtype.kind in "iu" else []
    count = math.prod(sides) if len(sides) == 3 and len(set(sides)) == 1 and sides[0] > 0 else 0
    check_unpacked(path, len(bits) * count if bits.ndim else 0)
    if bits.dtype != np.uint8 or bits.ndim != 2 or not count or bits.shape[1] != -(-count // 8):
        raise UserError(
            f"{path}: {bits.dtype} {bits.shape} are no bits of grids {sides}; pack with np.packbits(x, axis=1)"
        )
    return torch.from_numpy(np.unpackbits(bits, axis=1)[:, :count].reshape(-1, *sides))


def _read_files(path: Path, files: list[Path], resolution: int | None, up_axis: UpAxis, strict: bool) -> Found:
    volumes, skipped = {}, {}
    for file in files:
        name = file.relative_to(path).as_posix() if path.is_dir() else file.name
        try:
            volumes[name] = _read_file(file, resolution, up_axis)
        except (OSError, ValueError, KeyError, IndexError, TypeError, NotImplementedError) as error:
            reason = " ".join(str(error).split())[:160] or type(error).__name__
            if strict:
                raise UserError(f"{file}: {reason}; fix or remove it, or leave out --strict") from None
            skipped[name] = reason
    if not volumes:
        first = f" ({next(iter(skipped.items()))[0]}: {next(iter(skipped.values()))})" if skipped else ""
        raise UserError(
            f"{path}: no shape can be used{first}; give {', '.join(s[1:] for s in SUFFIXES)} files or an .npz of voxels"
        )
    _check_sizes(path, volumes)
    return Found(_stacked(volumes), tuple(volumes), None, tuple(skipped.items()), str(path))


def _check_sizes(path: Path, volumes: dict[str, Tensor]) -> None:
    sizes = {volume.shape[-1]: name for name, volume in volumes.items()}
    if len(sizes) > 1:
        listed = ", ".join(f"{name} {size}" for size, name in sizes.items())
        raise UserError(f"{path}: grids are of different sizes ({listed}); give a size to bring them to")


def _stacked(volumes: dict[str, Tensor]) -> Tensor:
    """All of them, as floats if one of them is."""
    grids = [*volumes.values()]
    mixed = any(grid.is_floating_point() for grid in grids)
    return torch.stack([to_floats(grid, white_of(grid[None])) for grid in grids] if mixed else grids)


def _read_file(file: Path, resolution: int | None, up_axis: UpAxis) -> Tensor:
    if file.suffix.lower() == ".binvox":
        volume = resized_volumes(turned_up(read_binvox(file)[None], up_axis), resolution)[0]
    else:
        volume = read_mesh(file, resolution or 32, up_axis)
    if not bool(volume.any()):
        raise ValueError(EMPTY)
    return volume


def read_mesh(file: Path, resolution: int = 32, up_axis: UpAxis = "y") -> Tensor:
    """The solid (R, R, R) inside a mesh, centred and scaled into the frame.

    Raises:
        ValueError: if the file has no triangles or cannot be parsed.
    """
    # trimesh takes a second to import, and most collections are pictures.
    import trimesh

    check_regular(file)
    try:
        vertices, faces = triangles_of(trimesh.load(file))
    except Exception as error:  # its readers raise whatever their parsers do
        raise ValueError(f"unreadable mesh: {error}") from None
    if not np.isfinite(vertices).all():
        raise ValueError("unreadable mesh: vertices are NaN or infinite")
    if up_axis == "z":
        vertices = vertices[:, [0, 2, 1]] * np.array([1, 1, -1])
    return torch.from_numpy(voxelise(normalised(vertices), faces, resolution))


def read_binvox(file: Path) -> Tensor:
    """A .binvox file as (N, N, N), indexed [x, y, z].

    Runs of (value, length) bytes after a text header; y runs fastest, then z, then x. Grids that are not cubes
    are padded to one.

    Raises:
        ValueError: if the header or the number of voxels is wrong.
    """
    check_regular(file)
    head, mark, body = file.read_bytes().partition(b"\ndata\n")
    lines = [line.split() for line in head.split(b"\n")]
    dims = [[int(n) for n in words[1:]] for words in lines if words[:1] == [b"dim"]]
    if lines[0][:1] != [b"#binvox"] or not mark or len(dims) != 1 or len(dims[0]) != 3 or min(dims[0]) < 1:
        raise ValueError("unreadable: no binvox header (#binvox, dim, data)")
    depth, height, width = dims[0]
    check_unpacked(file, max(dims[0]) ** 3)  # a cube
    runs = np.frombuffer(body, np.uint8)[: len(body) // 2 * 2].reshape(-1, 2)
    if runs[:, 1].sum(dtype=np.int64) != depth * height * width:
        raise ValueError(
            f"damaged: {runs[:, 1].sum(dtype=np.int64)} voxels where {depth * height * width} are announced"
        )
    grid = np.repeat((runs[:, 0] > 0).view(np.uint8), runs[:, 1]).reshape(depth, width, height).transpose(0, 2, 1)
    side = max(grid.shape)
    margins = [((side - n) // 2, side - n - (side - n) // 2) for n in grid.shape]
    return torch.from_numpy(np.pad(grid, margins))
