"""Formats: which of a domain's exporters is meant by `--to`, or by the name of the file to write."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .._types import UserError

if TYPE_CHECKING:
    from ..domains import Domain

SYNONYMS = {"materialx": "mtlx"}
TWINS = {"glb": "gltf", "gltf": "glb"}
"""glTF is `glb` of shapes, which are meshes, and `gltf` of materials: whichever of the two a domain has is meant."""
SUFFIXES = {"gltf": "glb", "maps": "", "mtlx": ""}
"""Of the file that a format writes, where it is not the format's name; "" of a folder."""
OTHERS = (
    *("gltf", "mtlx", "jpg", "jpeg", "webp", "exr", "tif", "tiff", "bmp", "svg", "pdf", "mp4", "webm", "mov", "zip"),
    *("stl", "off", "fbx", "usd", "usda", "usdc", "usdz", "blend", "abc", "dae", "3mf", "step", "stp", "x3d"),
)
"""Suffixes of files that no format writes."""


def format_of(to: str | None, out: Path, domain: Domain) -> str:
    """Return the format that is asked for: `to`, or else that of the file's suffix, or else the domain's own.

    Raises:
        UserError: for one that the domain does not have, or a file whose suffix is of another.
    """
    found = _of_file(out, domain) if to is None else _meant(SYNONYMS.get(to, to), domain)
    check_format(domain, found)
    _check_file(out, found)
    return found


def check_format(domain: Domain, to: str) -> None:
    """Raise UserError for a format that the domain does not have."""
    if to not in domain.exporters:
        raise UserError(f"--to {to}: there is no such format; choose from {', '.join(domain.exporters)}")


def suffix_of(to: str) -> str:
    """Return the suffix, without its dot, of the file that a format writes; "" of a folder.

    Examples:
        >>> suffix_of("obj"), suffix_of("gltf"), suffix_of("maps")
        ('obj', 'glb', '')
    """
    return SUFFIXES.get(to, to)


def _meant(to: str, domain: Domain) -> str:
    twin = TWINS.get(to, to)
    return twin if to not in domain.exporters and twin in domain.exporters else to


def _of_file(out: Path, domain: Domain) -> str:
    if out.is_dir() or not out.suffix:
        return domain.written
    suffix = out.suffix[1:].lower()
    of_suffix = {suffix_of(to): to for to in reversed(list(domain.exporters))}  # the first one, of several
    found = of_suffix.get(suffix, _meant(suffix, domain))
    return found if found in domain.exporters else domain.written


def _check_file(out: Path, to: str) -> None:
    from .. import export

    own = suffix_of(to)
    if out.suffix[1:].lower() in {*export.FORMATS, *OTHERS} - {own} and not out.is_dir():
        wanted = f"a name that ends in .{own}, or a folder" if own else "the name of a folder"
        raise UserError(f"--out {out}: --to {to} writes no such file; give {wanted}")
