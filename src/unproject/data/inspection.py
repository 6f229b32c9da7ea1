"""What a path will be used as: a table of every picture, and the collections that a run would get."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

from torch import Tensor

from .._types import printable
from ..ops.feet import ROUND, round_feet
from ..ops.framing import NARROW, aspect
from ..ops.outlines import LEVEL, level_share
from .collection import Collection
from .measured_lines import INTENSITIES, are_intensities, center_of, scale_of
from .readers.arrays import unread_arrays
from .readers.found import Found, check_size
from .readers.framing import Framing
from .readers.latents import LATENTS
from .readers.options import ReadOptions
from .readers.paths import holds_shapes
from .readers.pictures import found_of, stacked, survey_pictures
from .readers.shapes import is_shape_archive
from .reading import read
from .sampling import spread_rows

LINES, OFF = 50, 0.25
"""Lines of known angle that tell of their axis, and how many detectors from the middle are said."""
MAX_OUTLINES, MAX_COMPARED = 1024, 2**16
"""Pictures at most whose outlines are looked at."""


class FileRow(NamedTuple):
    """A file or item: its name, size, how it was read, and why it was skipped, "" if it is used."""

    name: str
    size: str = ""
    read_as: str = ""
    skipped: str = ""


@dataclass(frozen=True)
class Inspection:
    """What is used of a path, and what is not.

    Attributes:
        source: the path.
        collections: what a training run would get, by name: one collection, or one for each observation.
        rows: one for each file or item.
        notes: of materials, lines of text on what they are and what they show.
        materials: those of which patches are cut out, as they are.
        cropped: whether each picture is cropped to its object as it is read.
        unread: arrays of an .npz that are left, and their shapes.
        size: of the pictures that are learned from lines, pixels a side, if one was given.
    """

    source: str
    collections: Mapping[str, Collection]
    rows: tuple[FileRow, ...]
    notes: tuple[str, ...] = ()
    materials: Collection | None = None
    cropped: bool = False
    unread: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    size: int | None = None

    @property
    def skipped(self) -> tuple[FileRow, ...]:
        """The rows of what cannot be used."""
        return tuple(row for row in self.rows if row.skipped)

    @property
    def used(self) -> tuple[FileRow, ...]:
        """The rows of what is used."""
        return tuple(row for row in self.rows if not row.skipped)

    def table(self, limit: int = 20) -> str:
        """Return the text: what was skipped and why, how the rest was read, the totals."""
        rows = [*self.skipped[:limit], *self.used[:limit]]
        shown = [(printable(name), size, read_as, skipped or "used") for name, size, read_as, skipped in rows]
        widths = [max(len(row[k]) for row in shown) for k in range(3)]
        lines = ["  ".join((*(cell.ljust(w) for cell, w in zip(row, widths, strict=False)), row[3])) for row in shown]
        left = len(self.rows) - len(shown)
        return "\n".join([*lines, *([f"... and {left} more"] if left else []), "", *self.summary()])

    def summary(self) -> list[str]:
        """Return the totals, a line each."""
        used = len(self.used)
        how = Counter(row.read_as for row in self.used)
        lines = [f"{printable(self.source)}: {used} used, {len(self.skipped)} skipped"]
        if self.notes:
            return [*lines, *(f"  {note}" for note in self.notes)]
        lines += [f"  {count} read as {name}" for name, count in how.most_common()]
        for name, found in self.collections.items():
            views = ", ".join(found.latents) if found.latents else "unknown"
            lines.append(f"  {name}: {len(found)} of {' x '.join(map(str, found.shape))}; views: {views}")
            lines += same_pictures(found)
            lines += [f"  {latent}: {low:.1f}° to {high:.1f}°" for latent, (low, high) in degrees_of(found).items()]
            lines += readings_of(found)
            if self.size is not None and len(found.shape) == 2:
                lines.append(f"  learned as pictures of {self.size} x {self.size}: see --size of train")
        if self.unread:
            left = ", ".join(f"{printable(name)} {' x '.join(map(str, s))}" for name, s in self.unread.items())
            lines.append(f"  not read: {left}")
        found = self._silhouettes()
        return lines if found is None else [*lines, *self._outlines(found)]

    def _outlines(self, silhouettes: Tensor) -> list[str]:
        """Return a line of text on cameras, one on thickness, and one on round feet if most pictures show one."""
        level, feet = level_share(silhouettes), round_feet(silhouettes)
        down = "which does not tell that cameras were level, but of cropped pictures shapes take it so"
        down = down if self.cropped else "shapes learn the elevation of cameras too, if pictures were not cropped"
        cameras = "shapes take it that cameras were level" if level > LEVEL else down
        round_ones = f"  {feet:.0%} of pictures show a round foot: of unknown views shapes prefer bodies of revolution"
        narrow = f"the narrowest pictures are {aspect(silhouettes, NARROW):.2f} times as wide as high"
        thick = "of unknown views shapes prefer to be as thick as they look wide, up to that"
        lines = [f"  {level:.0%} of straight outlines are level: {cameras}", f"  {narrow}: {thick}"]
        return [*lines, *([round_ones] if feet > ROUND else [])]

    def level_outlines(self) -> float | None:
        """Return `ops.level_share` of silhouettes, None of others; shapes take cameras for level if it is high."""
        found = self._silhouettes()
        return None if found is None else round(level_share(found), 2)

    def round_feet(self) -> float | None:
        """Return `ops.round_feet` of silhouettes, None of others; shapes prefer bodies of revolution if it is high."""
        found = self._silhouettes()
        return None if found is None else round(round_feet(found), 2)

    def narrowest(self) -> float | None:
        """Return how wide the narrowest silhouettes are over their height, None of others."""
        found = self._silhouettes()
        return None if found is None else round(aspect(found, NARROW), 2)

    def _silhouettes(self) -> Tensor | None:
        """Return at most MAX_OUTLINES silhouettes, if there are any."""
        found = self.collections.get("silhouettes")
        return None if found is None else found.batch(spread_rows(len(found), MAX_OUTLINES))

    def as_dict(self) -> dict[str, Any]:
        """Return the same for JSON; `shape` and `views` are those of the first collection."""
        first = next(iter(self.collections.values()), None)
        return {
            "source": self.source,
            "used": len(self.used),
            "shape": None if first is None else [len(first), *first.shape],
            "views": None if first is None or first.latents is None else list(first.latents),
            "level_outlines": self.level_outlines(),
            "round_feet": self.round_feet(),
            "narrowest": self.narrowest(),
            "notes": [*self.notes],
            "not_read": {name: [*shape] for name, shape in self.unread.items()},
            "collections": {name: [len(found), *found.shape] for name, found in self.collections.items()},
            "skipped": [{"name": row.name, "reason": row.skipped} for row in self.skipped],
            "files": [{"name": row.name, "size": row.size, "read_as": row.read_as} for row in self.used],
        }


def degrees_of(collection: Collection) -> dict[str, tuple[float, float]]:
    """Return the least and the largest of the known angles, degrees."""
    angles = {n: v.rad2deg() for n, v in (collection.latents or {}).items() if n in LATENTS}
    return {name: (angle.min().item(), angle.max().item()) for name, angle in angles.items()}


def readings_of(collection: Collection) -> list[str]:
    """Return a line of text on the readings of line integrals, none of others."""
    if len(collection.shape) != 2:
        return []
    lines = collection.floats()
    scale = scale_of(collection)
    most = f"pictures show at most {scale / lines.shape[-1]:.3g} of their unit a detector's width"
    divided = "taken as they are" if scale == 1 else f"divided by {scale:g} for training: {most}"
    told = [f"  readings: {lines.min():g} to {lines.max():g}, {divided}"]
    if are_intensities(lines):
        told.append(f"  {INTENSITIES}")
    return told + axis_of(collection, lines)


def axis_of(collection: Collection, lines: Tensor) -> list[str]:
    """Return a line of text on the axis of rotation if known angles tell that it is off the middle of the detectors."""
    angle, middle = (collection.latents or {}).get("angle"), (collection.shape[-1] - 1) / 2
    if angle is None or len(angle) < LINES:
        return []
    center, error = center_of(lines, angle)
    if abs(center - middle) < max(OFF, 4 * error):
        return []
    return [
        f"  the axis of rotation seems to project to detector {center:.1f}, not to {middle:g}: see --center of train"
    ]


def same_pictures(found: Collection) -> list[str]:
    """Return a line of text if over a tenth of a collection that is in memory is the same as another part of it."""
    if not isinstance(found.stored, Tensor) or len(found) > MAX_COMPARED:
        return []
    same = len(found) - len({hash(item.numpy().tobytes()) for item in found.stored})
    return [f"  {same} are the same as another one"] if same > len(found) / 10 else []


def inspect(
    path: Path | str,
    size: int | None = None,
    *,
    pictures: Literal["silhouettes", "images"] = "silhouettes",
    framing: Framing | None = None,
    strict: bool = False,
) -> Inspection:
    """Read a path as `read` does, and say what becomes of each part.

    Raises:
        UserError: if there is nothing there; pictures that cannot be framed are rows, not errors.
    """
    path = Path(path)
    check_size(path, size)
    if path.is_dir() and pictures == "silhouettes" and not holds_shapes(path):
        return _inspect_silhouettes(path, ReadOptions(size, framing=framing, strict=strict))
    found = read(path, size, pictures=pictures, framing=framing, strict=strict)
    kind = {"line integrals": "line", "pictures": "picture", "volumes": "volume"}[Found(found.stored).kind]
    name = "silhouettes" if kind == "picture" and pictures == "silhouettes" else f"{kind}s"
    unread = {} if is_shape_archive(path) else unread_arrays(path)
    return replace(_inspection(path, {name: found}, {name: kind}), unread=unread, size=size)


def _inspection(path: Path, found: Mapping[str, Collection], kinds: Mapping[str, str]) -> Inspection:
    skipped = [FileRow(name, skipped=reason) for one in found.values() for name, reason in one.skipped]
    used = [
        FileRow(name, " x ".join(map(str, one.shape)), kinds[key]) for key, one in found.items() for name in one.names
    ]
    return Inspection(str(path), found, (*skipped, *used))


def _inspect_silhouettes(path: Path, options: ReadOptions) -> Inspection:
    found = survey_pictures(path, options)
    rows = [FileRow(name, skipped=reason) for name, reason in found.skipped.items()]
    rows += [FileRow(name, f"{item.width} x {item.height}", item.read_as) for name, item in found.used.items()]
    if not found.used:
        return Inspection(str(path), {}, tuple(rows))
    collection = found_of(path, tuple(found.skipped.items()), tuple(found.used), stacked(path, found))
    cropped = options.framing is None or options.framing.mode == "crop"
    return Inspection(str(path), {"silhouettes": Collection(**collection._asdict())}, tuple(rows), cropped=cropped)
