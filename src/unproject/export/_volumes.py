"""What every exporter takes and gives back: a checked batch of volumes, and an account of what was written."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unproject._files import atomic_path
from unproject._types import UserError


@dataclass(frozen=True)
class Written:
    """The files that were written, and (shape, reason) for each shape that was not."""

    paths: tuple[Path, ...]
    skipped: tuple[tuple[str, str], ...] = ()


def as_batch(volumes: ArrayLike) -> np.ndarray:
    """(B, X, Y, Z) float32 from a tensor or an array with or without the batch axis.

    Raises:
        UserError: no shapes, a wrong number of axes, images instead of volumes, or values that are not finite;
            the message names the first such shape.
    """
    batch = as_array(volumes)
    batch = batch[None] if batch.ndim == 3 else batch
    if batch.ndim != 4 or batch.size == 0:
        raise UserError(f"cannot export an array of shape {batch.shape}: volumes are (N, X, Y, Z) with N at least 1")
    if batch.shape[1] <= 4:
        raise UserError(f"an array of shape {batch.shape} holds images, not volumes: only shapes can be exported")
    finite = np.isfinite(batch).all(axis=(1, 2, 3))
    if not finite.all():
        raise UserError(f"shape {int(finite.argmin())} holds NaN or infinity: sample an earlier checkpoint of the run")
    return batch


def as_array(values: ArrayLike) -> np.ndarray:
    """float32 from a tensor, on any device, or an array."""
    detached: Any = values.detach().cpu() if hasattr(values, "detach") else values  # pyright: ignore
    return np.asarray(detached, dtype=np.float32)


def names_of(numbers: Sequence[int], stem: str = "shape_") -> tuple[str, ...]:
    """shape_00, shape_01, ...: names that sort in order."""
    digits = max(2, len(str(max(numbers, default=0))))
    return tuple(f"{stem}{number:0{digits}d}" for number in numbers)


def names_for(batch: Sized, names: Sequence[str] | None) -> tuple[str, ...]:
    """The names given, checked, or numbers.

    Raises:
        UserError: names that are not as many as the shapes, come twice, or could lead out of the folder.
    """
    if names is None:
        return names_of(range(len(batch)))
    if not len(names) == len(set(names)) == len(batch):
        given = f"{len(names)} were given, {len(set(names))} of them different"
        raise UserError(f"{len(batch)} samples need {len(batch)} different names, {given}")
    if bad := [name for name in names if name in ("", ".", "..") or re.search(r"[/\\:\0]", name)]:
        raise UserError(f"the name {bad[0]!r} is not that of a file: leave out / and \\ and :")
    return tuple(names)


def warn_left(folder: Path, names: Collection[str], pattern: str) -> None:
    """Warn of what an earlier export of more left in a folder, beside what was written now: the names of the rest."""
    left = [path.name for path in sorted(folder.glob("*")) if path.name not in names]
    if left := [name for name in left if re.fullmatch(pattern, name)]:
        several = f" and {len(left) - 1} more are" if len(left) > 1 else " is"
        warnings.warn(f"{folder}: {left[0]}{several} of an earlier export; remove what is not wanted", stacklevel=3)


def keep_usable(names: Sequence[str], make: Callable[[int], Any]) -> tuple[dict[str, Any], tuple[tuple[str, str], ...]]:
    """{name: make(i)}, and (name, reason) for each shape whose making is a UserError.

    Raises:
        UserError: not one shape is usable; the message is the first reason.
    """
    made, skipped = {}, []
    for i, name in enumerate(names):
        try:
            made[name] = make(i)
        except UserError as error:
            skipped.append((name, str(error)))
    if not made:
        raise UserError(skipped[0][1] if len(skipped) == 1 else f"all {len(skipped)} shapes: {skipped[0][1]}")
    return made, tuple(skipped)


def is_file(path: Path, suffix: str) -> bool:
    """A path that ends in the format's suffix is one file, any other a folder."""
    return path.suffix.lower() == suffix and not path.is_dir()


def within(path: Path, suffix: str, name: str) -> Path:
    """The path if it is a file of this format, else `name` in that folder."""
    return path if is_file(path, suffix) else path / name


def floor_grid(n: int, spacing: float) -> Iterator[tuple[float, float]]:
    """(x, z) of n shapes in rows on the floor, centred on the origin, the first row towards the viewer."""
    columns = int(np.ceil(np.sqrt(n)))
    rows = int(np.ceil(n / columns))
    for i in range(n):
        row, column = divmod(i, columns)
        yield (column - (columns - 1) / 2) * spacing, ((rows - 1) / 2 - row) * spacing


def save(path: Path, content: bytes | str) -> Path:
    """Write the file whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    return path
