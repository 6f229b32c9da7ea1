"""Kinds of photographs of materials: the names of sub-folders, by how their pictures were lit, and what each shows.

What each shows of how maps go together was measured (docs/results.md, "What photographs show of correlations").
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..._files import files_with
from ..._objects import nearest
from ..._types import UserError
from ...ops.maps import MAPS
from .pictures import SAVE
from .pictures import SUFFIXES as PICTURES
from .pictures import UNREAD as NO_PICTURES
from .texture_names import candidates

FLOATING = (".exr", ".hdr")
SUFFIXES = (*PICTURES, *FLOATING)
UNREAD = tuple(suffix for suffix in NO_PICTURES if suffix not in FLOATING)
ELSE = (
    "flash, coloured, overhead, slanting, raking, lamp, ambient (an overcast sky or a light tent), or top and grazing "
    "(natural light that you give by --probes)"
)
MAX_NAMED = 3
"""Sub-folders that a message names at most."""


class Kind(NamedTuple):
    """How photographs of a kind were taken, and what they show of the maps."""

    light: str
    shows: str


KINDS = {
    "top": Kind("natural light of --probes, from above", "the colours"),
    "grazing": Kind("natural light of --probes, seen at 80° from the normal, rectified", "little but the colours"),
    "flash": Kind("a flash at the camera", "most of how maps go together"),
    "lamp": Kind("one lamp, anywhere above", "the colours"),
    "raking": Kind("one lamp at the left, 60° from the normal", "a little of the relief"),
    "coloured": Kind(
        "three lamps 60° from the normal, red at the left, green at the lower right, blue at the upper right",
        "the relief and how maps go with it",
    ),
    "overhead": Kind(
        "the same three lamps 12° from the normal, close to the camera", "how the gloss goes with the relief"
    ),
    "slanting": Kind("the same three lamps 36° from the normal", "how the gloss goes with the colours and the relief"),
    "ambient": Kind("an overcast sky or a light tent", "how the gloss goes with the colours"),
    "daylight": Kind("daylight or light of a room that nobody measured", "the colours"),
}
"""Name of the sub-folder → kind of photographs, all but `grazing` from above."""
TELLING = frozenset({"flash", "coloured", "overhead", "slanting", "raking"})
"""Kinds that tell every map, at least a little; the others hardly more than the colours."""
OBSERVATIONS = (*MAPS, *KINDS)
"""Names of sub-folders: maps, and photographs by their light and camera."""
FIRST = ("flash", "coloured", "ambient", "overhead")
"""Kinds that determine the maps together, the one that shows most first: those of recipes without photographs."""


def photographed(path: Path) -> tuple[str, ...]:
    """The observations that a folder has sub-folders of pictures for, in the order of `OBSERVATIONS`."""
    return tuple(name for name in OBSERVATIONS if sub_folder(path, name) is not None)


def sub_folder(path: Path, name: str) -> Path | None:
    """The sub-folder of an observation, spelt in small letters or others; None if there is none."""
    if (path / name).is_dir() or not path.is_dir():
        return path / name if path.is_dir() else None
    return next((below for below in sorted(path.iterdir()) if below.name.lower() == name and below.is_dir()), None)


def unsorted(path: Path) -> dict[Path, str]:
    """Return each picture of a folder that no observation is made of, and why: nothing says its light, or it is unread.

    Those that have a sub-folder and are damaged are not among them.
    """
    found = {}
    for file in files_with(path, (*SUFFIXES, *UNREAD)):
        first, *below = file.relative_to(path).parts
        if file.suffix.lower() in UNREAD:
            found[file] = f"{file.suffix} is not read; {SAVE}"
        elif not below:
            found[file] = f"lies in no sub-folder that says its light; move it into one, such as {path / 'daylight'}"
        elif first.lower() in OBSERVATIONS and sub_folder(path, first.lower()) != path / first:
            found[file] = f"{path / first}: beside it {sub_folder(path, first.lower())} is read; move them there"
        elif first.lower() not in OBSERVATIONS:
            found[file] = f"{path / first}: names neither a map nor a light{_meant(first)}"
    return found


ALSO = {
    "ambient": ("cloudy", "overcast", "shade", "shadow", "indirect", "diffused", "tent"),
    "daylight": ("sun", "sunny", "outdoor", "outdoors", "day", "indoor", "indoors", "room", "window", "phone"),
    "flash": ("camera_flash", "flashlight", "strobe"),
}  # fmt: skip
"""Names that people give to a light, which may be nearer to the spelling of another one."""


def _meant(name: str) -> str:
    """Return which observation a sub-folder may be meant for."""
    known = [observation for observation, others in ALSO.items() if name.lower() in others]
    return f". Perhaps you meant {known[0]!r}" if known else nearest(name, OBSERVATIONS)


def refuse_unsorted(path: Path) -> None:
    """Refuse a folder of photographs of which nothing says how they were lit, and whose names are no maps'.

    Raises:
        UserError: saying into which sub-folders to put them; or, if none is of a format that is read, how to save them.
    """
    found = unsorted(path)
    files = [*found]
    if not files or any(candidates(folder) for folder in {file.parent for file in files}):
        return
    if all(file.suffix.lower() in UNREAD for file in files):
        raise UserError(f"{path}: none of the {len(files)} pictures can be used ({files[0].name}: {found[files[0]]})")
    if path.name.lower() in OBSERVATIONS:
        raise UserError(f"{path}: is what a folder of materials has as a sub-folder; name {path.absolute().parent}")
    inside = sorted({file.relative_to(path).parts[0] for file in files if file.parent != path})
    where = f" in {', '.join(inside[:MAX_NAMED])}{', ...' if len(inside) > MAX_NAMED else ''}" if inside else ""
    raise UserError(
        f"{path}: holds {len(files)} photographs{where} and nothing says their light; put them in sub-folders by it: "
        f"{path / 'daylight'} for daylight or light of a room that nobody measured; else {ELSE}"
    )


def showing(names: Sequence[str]) -> list[str]:
    """Return lines of text: what photographs of these observations show of the maps, and what to add first."""
    taken = [name for name in names if name in KINDS]
    by_what: dict[str, list[str]] = {}
    for name in taken:
        by_what.setdefault(KINDS[name].shows, []).append(name)
    shown = "; ".join(f"{', '.join(kinds)}: {what}" for what, kinds in by_what.items())
    lacking = next((name for name in FIRST if name not in taken), None)
    lines = (
        [f"they show the maps so far: {shown}"] if shown else ["without photographs nothing says how maps go together"]
    )
    if lacking is not None:
        lines.append(f"what would help most: {lacking}/ ({KINDS[lacking].light}), for {KINDS[lacking].shows}")
    return lines
