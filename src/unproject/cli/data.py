"""`unproject data inspect PATH` and `unproject data get NAME`."""

from __future__ import annotations

import json as json_format
import os
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .._types import UserError

if TYPE_CHECKING:
    from ..data.records import Records


def run(
    action: Literal["inspect", "get"],
    path: Path,
    /,
    *,
    out: Path | None = None,
    size: int | None = None,
    mode: Literal["crop", "keep"] | None = None,
    threshold: float | None = None,
    polarity: Literal["auto", "light", "dark"] | None = None,
    strict: bool = False,
    json: bool = False,
) -> None:
    """See what a collection will be used as, what is skipped and why; or get a public one.

    Args:
        action: `inspect` a collection, or `get` a public one from the network (the variable UNPROJECT_MIRROR names
            another address to take its files from).
        path: A folder of pictures, an .npz, .npy or idx file, or a 3-D collection; to get one, its name: mnist.
        out: Write a contact sheet of the framed pictures to this PNG file; or the folder to get a collection into,
            which is called as the collection unless given.
        size: Side of the framed pictures in pixels; 64 for folders, as stored for arrays, unless given.
        mode: Crop and centre the object, or keep it where it is; crop for folders, keep for arrays unless given.
        threshold: Coverage at which a pixel belongs to the object; 0.5 for masks, 0.08 for photographs unless given.
        polarity: Whether the object is light or dark; auto, which it is unless given, reads it off the border.
        strict: Fail on the first file that cannot be used.
        json: Print one JSON object instead of the table.
    """
    from ..data import Framing, get, inspect

    if action == "get":
        get(str(path), out or Path(path.name), os.environ.get("UNPROJECT_MIRROR"), print)
        return
    given = {"mode": mode, "threshold": threshold, "photo_threshold": threshold, "polarity": polarity}
    given = {name: value for name, value in given.items() if value is not None}
    framing = Framing(**given) if given else None  # pyright: ignore[reportArgumentType]
    found = inspect(path, size=size, framing=framing, strict=strict)
    print(json_format.dumps(found.as_dict()) if json else found.table())
    if found.collection is None:
        name, _, _, reason = found.rows[0]
        raise UserError(f"{path}: none of the {len(found.rows)} pictures can be used ({name}: {reason})")
    if out is not None:
        _write_sheet(found.collection, out)


def _write_sheet(collection: Records, out: Path) -> None:
    from .._files import atomic_path
    from ..data import contact_sheet

    if out.suffix.lower() not in (".png", ".jpg", ".jpeg", ".webp"):
        raise UserError(f"{out}: a contact sheet is a picture; name it .png")
    with atomic_path(out) as temporary:
        contact_sheet(collection).save(temporary)
