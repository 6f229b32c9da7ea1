"""The contact sheet of `unproject data inspect`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .._types import UserError

if TYPE_CHECKING:
    from torch import Tensor

    from ..data import Collection, Inspection

COLUMNS = 8
ROWS = 4
"""Of photographs, if there are so few kinds of them."""


def check_name(out: Path) -> None:
    """Raise UserError for a path that is no picture."""
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg", ".webp"):
        raise UserError(f"{out}: a contact sheet is a picture; name it .png")


def write_sheet(found: Inspection, out: Path) -> None:
    """Draw some of what training gets: silhouettes, graphs, shaded volumes, photographs by light, or materials."""
    from ..data import OBSERVATIONS

    if found.materials is not None:
        return _sheet_of_materials(found.materials, out)
    if {*found.collections} <= {*OBSERVATIONS}:
        return _sheet_of_photographs(found, out)
    _sheet_of(next(iter(found.collections.values())), out)


def _sheet_of(collection: Collection, out: Path) -> None:
    """64 items spread over the collection: pictures, graphs of line integrals, or shaded volumes."""
    from .. import export

    items = _spread(collection, COLUMNS**2)
    if items.dim() == 4 and items.shape[1] > 3:
        export.gallery(items, out, columns=COLUMNS, size=96)
        return
    export.picture_sheet(export.graphs(items) if items.dim() == 3 else items, out, columns=COLUMNS)


def _sheet_of_photographs(found: Inspection, out: Path) -> None:
    """Some pictures of each observation in rows of their own, as `material_sheet` shows maps."""
    from ..data.readers.lights import KINDS
    from ..export import grouped_sheet, map_picture

    groups = {}
    count = COLUMNS * max(1, ROWS // len(found.collections))
    for name, collection in found.collections.items():
        what = KINDS[name].light if name in KINDS else "maps"
        groups[f"{name}: {len(collection)} ({what})"] = map_picture(name, _spread(collection, count))
    grouped_sheet(groups, out, columns=COLUMNS)


def _sheet_of_materials(collection: Collection, out: Path) -> None:
    """Up to 8 materials, a row each: their four maps, and a rendering."""
    import torch

    from ..data.sampling import spread_rows
    from ..domains.maps import under_a_lamp
    from ..export import grouped_sheet, map_picture
    from ..ops.maps import unpack_maps

    rows = spread_rows(len(collection), COLUMNS)
    groups = {}
    for row in rows.tolist():
        maps = collection.batch([row])
        pictures = [map_picture(name, part).expand(-1, 3, -1, -1) for name, part in unpack_maps(maps).items()]
        name = collection.names[row]
        same = f" (row {row})" if collection.names.count(name) > 1 else ""
        caption = f"{name}{same}: diffuse, specular, roughness, normal; lit by a lamp"
        groups[caption] = torch.cat([*pictures, under_a_lamp(maps)])
    grouped_sheet(groups, out, columns=5)


def _spread(collection: Collection, count: int) -> Tensor:
    """Up to `count` items, evenly spread over the collection."""
    from ..data.sampling import spread_rows

    return collection.batch(spread_rows(len(collection), count))
