"""Packs: a folder's pictures, framed once, in one .npz that is mapped into memory when it is learned from.

`silhouettes` or `images` (N, C, H, W), not compressed, with `names` (N,), `skipped` and `reasons` (M,), known views
(N,) in radians, and `side`, the median side of the files: what readers take of a folder.

Parts of the pack are written one after another beside it, each whole or not at all, so that packing goes on where it
was killed. They belong to these files, as they are now, read in this way; the pack is made of all and appears at once.
"""

from __future__ import annotations

import glob
import hashlib
import math
import os
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._files import atomic_path, check_replaceable, is_broken_link
from .._types import UserError
from .readers.found import check_size
from .readers.options import ReadOptions
from .readers.pictures import SUFFIXES, UNREAD, check_sizes, check_used, reading, required_pictures, unit_values
from .readers.sides import side_of
from .readers.surveying import Item, items_of
from .readers.views import views_beside

FILES_PER_PART = 1024
"""Files of a part: at most so many are read again after a kill."""


class Packed(NamedTuple):
    """What a pack holds: how many pictures, their shape, and (name, reason) of each file that was skipped."""

    path: Path
    count: int
    shape: tuple[int, ...]
    skipped: tuple[tuple[str, str], ...]


def pack(
    path: Path, out: Path, options: ReadOptions, report: Callable[[int, int], None] = lambda done, total: None
) -> Packed:
    """Read a folder of pictures into the pack `out`, on all cores; go on with what an earlier call has done.

    Args:
        path: the folder.
        out: an .npz file, which appears when it is complete.
        options: how the pictures are read.
        report: is called with the files that are done, and all files.

    Raises:
        UserError: if there is no picture that can be used, with `options.strict` one that cannot, if sizes differ, or
            `views.csv` does not fit.
    """
    check_size(path, options.size)
    if out.suffix != ".npz":
        raise UserError(f"{out}: a pack is an .npz; give --out a name that ends in .npz")
    check_replaceable(out)
    if out.is_dir():
        raise UserError(f"{out}: is a folder; give --out the name of a file")
    files = required_pictures(path, (*SUFFIXES, *UNREAD))
    parts = out.with_name(f".{out.name}.{_identity(path, files, options)}.parts")
    starts = range(0, len(files), FILES_PER_PART)
    _write_parts(path, parts, [files[i : i + FILES_PER_PART] for i in starts], options, report)
    found = _pack_of(path, out, [parts / f"{i:06d}.npz" for i in range(len(starts))], parts, options)
    for old in out.parent.glob(f".{glob.escape(out.name)}.*.parts"):
        shutil.rmtree(old, ignore_errors=True)
    return found


def _identity(path: Path, files: Sequence[Path], options: ReadOptions) -> str:
    """Return a digest of how files are read, their names, lengths and times."""
    digest = hashlib.sha256(repr(options).encode())
    for file in files:
        stat = file.stat(follow_symlinks=not is_broken_link(file))
        digest.update(os.fsencode(file.relative_to(path)) + f" {stat.st_size} {stat.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:12]


def _write_parts(
    path: Path, parts: Path, groups: Sequence[Sequence[Path]], options: ReadOptions, report: Callable[[int, int], None]
) -> None:
    """Write those parts that are not there."""
    missing = [i for i in range(len(groups)) if not (parts / f"{i:06d}.npz").exists()]
    total = sum(map(len, groups))
    done = total - sum(len(groups[i]) for i in missing)
    read = reading(options, [file for group in groups for file in group])
    items = items_of([file for i in missing for file in groups[i]], read, options.strict)
    for i in missing:
        report(done, total)
        _write_part(parts / f"{i:06d}.npz", path, islice(items, len(groups[i])))
        done += len(groups[i])
    report(done, total)


def _write_part(part: Path, path: Path, items: Iterator[tuple[Path, Item | str]]) -> None:
    found = [(file.relative_to(path).as_posix(), item) for file, item in items]
    used = [(name, item.values) for name, item in found if isinstance(item, Item)]
    skipped = [(name, item) for name, item in found if isinstance(item, str)]
    check_sizes(path, {values.shape[1:]: name for name, values in reversed(used)})
    floats = any(values.dtype != np.uint8 for _, values in used)
    stacked = np.stack([unit_values(v) if floats else v for _, v in used]) if used else np.zeros(0, np.uint8)
    with atomic_path(part) as temporary:
        np.savez(
            temporary,
            items=stacked,
            names=_texts([name for name, _ in used]),
            skipped=_texts([name for name, _ in skipped]),
            reasons=_texts([reason for _, reason in skipped]),
        )


def _pack_of(path: Path, out: Path, parts: Sequence[Path], folder: Path, options: ReadOptions) -> Packed:
    """Join the parts."""
    tables = [_table(part) for part in parts]
    names, skipped, reasons = (np.concatenate([t[key] for t in tables]) for key in ("names", "skipped", "reasons"))
    reported = tuple((_text(name), _text(reason)) for name, reason in zip(skipped, reasons, strict=True))
    if not len(names):
        shutil.rmtree(folder)  # nothing in it is worth going on from
    check_used(path, len(names), reported)
    check_sizes(path, {t["shape"][1:]: _text(t["names"][0]) for t in reversed(tables) if len(t["names"])})
    shape = next(t["shape"] for t in tables if len(t["names"]))
    views = views_beside(path, [_text(name) for name in names.tolist()], [name for name, _ in reported]) or {}
    columns = {"names": names, "skipped": skipped, "reasons": reasons, "side": np.array(side_of(path) or 0)}
    columns |= {name: angles.numpy() for name, angles in views.items()}
    if "azimuth" in columns:  # beyond two turns angles of a file are taken for degrees
        columns["azimuth"] = columns["azimuth"] % np.float32(2 * math.pi)
    dtype = np.dtype("uint8" if all(t["dtype"] == np.uint8 for t in tables) else "float32")
    with atomic_path(folder / "whole.npz") as temporary, zipfile.ZipFile(temporary, "w") as archive:
        key = "images" if options.images else "silhouettes"
        _write_items(archive, key, (len(names), *shape), dtype, parts)
        for name, column in columns.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, column)
    os.replace(folder / "whole.npz", out)
    return Packed(out, len(names), shape, reported)


def _table(part: Path) -> dict[str, Any]:
    """A part without its pictures, but for their shape."""
    with np.load(part) as arrays:
        items = arrays["items"]
        return {key: arrays[key] for key in ("names", "skipped", "reasons")} | {
            "shape": items.shape[1:],
            "dtype": items.dtype,
        }


def _write_items(archive: zipfile.ZipFile, key: str, shape: tuple[int, ...], dtype: Any, parts: Sequence[Path]) -> None:
    with archive.open(zipfile.ZipInfo(f"{key}.npy"), "w", force_zip64=True) as member:
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(member, header)
        for part in parts:
            with np.load(part) as arrays:
                items = arrays["items"]
            member.write((unit_values(items) if dtype == np.float32 else items).tobytes())


def _texts(texts: Sequence[str]) -> np.ndarray:
    """UTF-8, as numpy stores bytes: a quarter of what its text takes. Names of files may be other bytes."""
    return np.array([text.encode(errors="surrogateescape") for text in texts], dtype=bytes)


def _text(stored: bytes) -> str:
    return stored.decode(errors="surrogateescape")
