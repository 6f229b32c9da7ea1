"""`unproject data inspect PATH`, `unproject data pack FOLDER` and `unproject data get NAME`."""

from __future__ import annotations

import inspect as inspect_module
import json as json_format
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .._objects import nearest
from .._types import UserError, printable
from ._arguments import HelpPrinted, bind, find_recipe

if TYPE_CHECKING:
    from ..data import Framing, Inspection


def parse(argv: Sequence[str]) -> Callable[[], Any]:
    """Return what to call for `inspect PATH`, `pack FOLDER` or `get NAME`: each has flags of its own."""
    first = argv[0] if argv else ""
    if first in ("-h", "--help"):
        print(usage())
        raise HelpPrinted
    if first not in ACTIONS:
        choices = f"choose from {', '.join(ACTIONS)}; flags come behind"
        raise UserError(f"data {first!r}: {choices}{nearest(first, ACTIONS)} (`unproject data --help`)")
    return bind(f"data {first}", argv[1:], ACTIONS[first])[0]


def usage() -> str:
    """What `unproject data --help` prints."""
    first = {name: (call.__doc__ or "").partition("\n")[0] for name, call in ACTIONS.items()}
    lines = "\n".join(f"  {name:<8} {line}" for name, line in first.items())
    return f"usage: unproject data {{{','.join(ACTIONS)}}} ...\n\n{lines}\n\n`unproject data ACTION --help` tells more."


def inspect_path(
    path: Path,
    /,
    *,
    for_: str | None = None,
    out: Path | None = None,
    size: int | None = None,
    mode: Literal["crop", "keep"] | None = None,
    threshold: float | None = None,
    polarity: Literal["auto", "light", "dark"] | None = None,
    strict: bool = False,
    json: bool = False,
) -> None:
    """Show what a recipe would be given of a path, what is skipped and why.

    Args:
        path: A folder of pictures, an .npz, .npy or idx file, a 3-D collection, or materials.
        for_: The recipe that is to learn from it: shapes, digits, materials, ..., or your own recipe, read as one for
            shapes (default: materials if the path clearly holds materials, else shapes; it says which).
        out: Write a contact sheet to this PNG file.
        size: Side of the pictures in pixels (default: the recipe's).
        mode: Crop and centre the object, or keep it where it is (default: crop for folders, keep for arrays).
        threshold: Coverage at which a pixel belongs to the object (default: 0.5 for masks, 0.08 for photographs).
        polarity: Whether objects are light or dark, where pictures are opaque; auto reads it off the border (default).
        strict: Fail on the first file that cannot be used.
        json: Print one JSON object instead of the table.
    """
    from ._sheets import check_name, write_sheet

    if out is not None:
        check_name(out)
    framing = _framing(path, mode, threshold, polarity)
    recipe = for_ or _recipe_for(path, framing)
    found = _inspected(path, recipe, size, framing, strict)
    print(json_format.dumps({**found.as_dict(), "for": recipe}) if json else found.table())
    if not found.collections:
        first = found.rows[0]
        surfaces = "; photographs of surfaces are read with --for materials" if recipe == "shapes" else ""
        why = f"none of the {len(found.rows)} pictures can be used ({first.name}: {first.skipped}); fix one{surfaces}"
        raise UserError(f"{path}: {why}")
    if for_ is None and not json:
        _say_what_for(found, recipe)
    if recipe == "shapes" and size is None and not json:
        _say_how_to_train(path, found)
    if out is not None:
        write_sheet(found, out)
        if path.is_dir() and Path(os.path.realpath(path)) in Path(os.path.realpath(out)).parents:
            print(f"warning: {out}: lies in the folder and will be taken for data; move it", file=sys.stderr)


def pack_folder(
    path: Path,
    /,
    *,
    for_: str | None = None,
    out: Path | None = None,
    size: int | None = None,
    mode: Literal["crop", "keep"] | None = None,
    threshold: float | None = None,
    polarity: Literal["auto", "light", "dark"] | None = None,
    strict: bool = False,
) -> None:
    """Pack a folder of pictures into one .npz, once, from which `train --data` starts at once whatever its size.

    What was packed before a kill is kept.

    Args:
        path: A folder of pictures.
        for_: The recipe that is to learn from it (default: shapes).
        out: The pack to write (default: PATH.npz, unless another file than a pack is there).
        size: Side of the pictures in pixels (default: the recipe's; of silhouettes twice that, since cropped ones are
            framed anew).
        mode: Crop and centre the object (default), or keep it where it is.
        threshold: Coverage at which a pixel belongs to the object (default: 0.5 for masks, 0.08 for photographs).
        polarity: Whether objects are light or dark, where pictures are opaque; auto reads it off the border (default).
        strict: Fail on the first file that cannot be used.
    """
    framing = _framing(path, mode, threshold, polarity)
    _pack(path, out, for_ or _recipe_for(path, framing), size, framing, strict)


def get_collection(name: str, /, *, out: Path | None = None) -> None:
    """Get a public collection from the network (UNPROJECT_MIRROR names another address to take its files from).

    Args:
        name: mnist.
        out: The folder to get it into (default: its name).
    """
    from ..data import get

    get(name, out or Path(name), os.environ.get("UNPROJECT_MIRROR"), print)


ACTIONS: dict[str, Callable[..., None]] = {"inspect": inspect_path, "pack": pack_folder, "get": get_collection}


def _recipe_for(path: Path, framing: Framing | None) -> str:
    """Return the recipe that a path is for: framing makes sense of silhouettes only."""
    from ..data import holds_materials

    return "materials" if framing is None and holds_materials(path) else "shapes"


def _say_what_for(found: Inspection, recipe: str) -> None:
    """Say which recipe was chosen, if another one may be meant."""
    if recipe == "materials":
        print("  read as materials, which the recipe materials learns; --for shapes reads silhouettes")
    elif 2 * sum("photograph" in row.read_as for row in found.used) > len(found.used):
        print("  read as silhouettes of objects; --for materials reads photographs of surfaces")


def _say_how_to_train(path: Path, found: Inspection) -> None:
    """Say which recipe learns from it, with which views and at which size."""
    if "lines" in found.collections:
        print("  line integrals: the recipe digits learns images from them; see --for digits")
        return
    if any("azimuth" in (collection.latents or {}) for collection in found.collections.values()):
        print("  azimuths are known: --views known trains with them")
    _say_size(path)
    _say_if_few(found)


def _say_size(path: Path) -> None:
    """Say at what size these pictures are learned, which the budget decides too."""
    from ..data import side_of
    from ..recipes.sizes import LARGE, LEAST_MINUTES, MIN_PICTURES, SMALL

    chosen = _size_of("shapes", path)
    few = chosen == SMALL and (side_of(path) or 0) >= LARGE
    why = f", since these are fewer than {MIN_PICTURES:,} pictures; --size {LARGE} overrides" if few else ""
    short = f"; with --minutes under {LEAST_MINUTES:g} at {SMALL}" if chosen > SMALL else ""
    print(f"  shapes are learned at {chosen} voxels a side{short}{why}")


ADVISED = 100


def _say_if_few(found: Inspection) -> None:
    """Say that shapes need more pictures than these."""
    count = len(found.collections.get("silhouettes", ()))
    if 0 < count < ADVISED:
        print(f"  {count} pictures are few: a hundred at least are advised")


def _framing(path: Path, mode: str | None, threshold: float | None, polarity: str | None) -> Framing | None:
    """Return what was given, of arrays with the mode that they are kept in; None if nothing was."""
    from ..data import Framing

    given: dict[str, Any] = {
        "mode": mode,
        "threshold": threshold,
        "photo_threshold": threshold,
        "polarity": polarity,
    }
    given = {name: value for name, value in given.items() if value is not None}
    if given and not path.is_dir():
        given = {"mode": "keep", **given}
    return Framing(**given) if given else None


AS_THEY_ARE = "takes pictures as they are; leave out --mode, --threshold and --polarity"


def _kind_of(recipe: str) -> str:
    """Return "materials" for any recipe of materials, else its name without what follows a hyphen."""
    from ..recipes.materials import PROCEDURAL

    kind = recipe.partition("-")[0]
    return "materials" if kind in PROCEDURAL else kind


def _inspected(path: Path, recipe: str, size: int | None, framing: Framing | None, strict: bool) -> Inspection:
    """Read a path as this recipe does, at its size."""
    from ..data import inspect, inspect_materials

    find_recipe(recipe)  # mistakes come first
    size, kind = _size_of(recipe, path) if size is None else size, _kind_of(recipe)
    if framing is not None and kind in ("digits", "materials"):
        raise UserError(f"--for {recipe}: {AS_THEY_ARE}")
    if kind == "materials":
        return inspect_materials(path, size, strict=strict)
    pictures = "images" if kind == "digits" else "silhouettes"
    found = inspect(path, size, pictures=pictures, framing=framing, strict=strict)
    if kind == "digits" and "volumes" in found.collections:
        raise UserError(f"{path}: holds volumes; {recipe} learns images; --for shapes reads it")
    return found


def _pack(path: Path, out: Path | None, recipe: str, size: int | None, framing: Framing | None, strict: bool) -> None:
    """Pack a folder as this recipe reads it."""
    from rich.console import Console
    from rich.progress import Progress

    from ..data import ReadOptions, pack

    find_recipe(recipe)
    kind = _kind_of(recipe)
    if kind == "materials":
        raise UserError(
            f"{path}: materials are read from their folder, as `train {recipe} --data` does; "
            "--for shapes packs silhouettes"
        )
    images = kind == "digits"
    if framing is not None and images:
        raise UserError(f"--for {recipe}: {AS_THEY_ARE}")
    size = _size_of(recipe, path) * (1 if images else ENLARGED) if size is None else size
    out = out or _pack_beside(path)
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("packing")
        options = ReadOptions(size, images=images, framing=framing, strict=strict)
        found = pack(path, out, options, lambda done, total: bar.update(task, completed=done, total=total))
    for name, reason in found.skipped[:SHOWN]:
        print(printable(f"skipped {name}: {reason}"))
    shape = " x ".join(map(str, found.shape))
    print(f"{found.path}: {found.count} pictures of {shape}, {len(found.skipped)} skipped")


def _pack_beside(folder: Path) -> Path:
    """Return where the pack of a folder lies unless one is named.

    Raises:
        UserError: if something else is there, such as arrays of the same pictures, which nobody asked to replace.
    """
    from ..data.readers.sides import is_pack

    whole = folder if folder.name not in ("", "..") else folder.resolve()
    out = whole.with_name(f"{whole.name}.npz")
    if out.exists() and not is_pack(out):
        raise UserError(f"{out}: is there and is no pack; name another file by --out, or this one to replace it")
    return out


ENLARGED, SHOWN = 2, 20
"""Packed silhouettes are so many times as large as the recipe's, and skipped files that are named."""


def _size_of(recipe: str, path: Path) -> int:
    """The default of the recipe's own `size`, or what it chooses for a path."""
    function = find_recipe(recipe)
    chosen = getattr(function, "size_of_data", None)
    if chosen is not None:
        return chosen(path, {})
    parameters = inspect_module.signature(function).parameters
    if "size" not in parameters or not isinstance(parameters["size"].default, int):
        raise UserError(f"--for {recipe}: has no default size; give --size")
    return parameters["size"].default
