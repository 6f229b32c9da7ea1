"""`unproject export RUN --to FORMAT --n N --out PATH`."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from .._types import UserError, printable
from ._formats import SYNONYMS, format_of
from ._machine import say_skipped, warn_if_empty
from ._materials import read_maps

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..domains import Domain
    from ..export import Written


def run(
    source: Path,
    /,
    *,
    out: Path,
    to: str | None = None,
    n: int | None = None,
    seed: int = 0,
    only: tuple[int, ...] = (),
    faces: int | None = None,
    hull: bool = False,
    largest_part: bool = True,
    depth: Literal["8", "16", "half", "float"] | None = None,
    fresnel: Literal["eta", "albedo"] | None = None,
    eta: float | None = None,
    size: int | None = None,
    coloured_specular: bool = False,
    trust: bool = False,
) -> None:
    """Write samples of a run, or those that `unproject sample` wrote, for other tools.

    Args:
        source: A run directory, an .npz of `unproject sample`, or a folder of textures.
        out: The file (with the format's suffix; meshes stand side by side in one) or the folder to write.
        to: npz (arrays) and png (a picture) of any run; of shapes glb, obj and ply (meshes), vox (voxels) and gif (a
            turntable); of materials maps (folders of PNG or EXR), mtlx or materialx (the same with MaterialX) and gltf
            or glb (a .glb of planes); of a domain of your own what it exports (default: by the suffix of --out; of a
            folder glb of shapes, maps of materials, png of images, else npz).
        n: How many (default: 16 of a run or an .npz of shapes, all of a file or folder of materials).
        seed: Which samples: the same seed draws the same ones.
        only: Those of them with these numbers, from 0, as a png shows them (of images they run along its rows);
            meshes, voxels and folders of several materials keep the numbers.
        faces: The most triangles a mesh may have (glb, obj, ply); a warning says so where it has to have more.
        hull: Fill what no level view can see.
        largest_part: Join near parts of each shape, and keep the largest alone.
        depth: Bits of the maps' PNG, or half or float EXR (default: 8).
        fresnel: What the specular map of materials means: see `unproject render --help`.
        eta: The index of refraction, for --fresnel eta (default: 1.5).
        size: Of a run, voxels a side of shapes or texels a side of materials: a multiple of what was trained. 128
            after 64 are shapes twice as fine; 1024 after 64 are materials that cover 16 times the side. Of folders of
            textures, pixels a side, to which they are resampled.
        coloured_specular: Of folders of textures: metals reflect their colour (default: the luminance of it).
        trust: Import the generator's code although it is not of this package.
    """
    import torch

    from .._files import naming

    found = _chosen(_found(source, to, _count(n, only), seed, trust, size, coloured_specular), only)
    to = format_of(to, out, found.domain)
    given = {"depth": depth, "fresnel": fresnel, "eta": eta}
    given = {name: value for name, value in given.items() if value is not None}
    options = _options(found.domain, to, faces, hull, given)
    x = _hull(found.x) if hull else torch.as_tensor(found.x)
    with naming(out):
        written = found.domain.write(x, to, out, largest_part=largest_part, numbers=only or None, **options)
    _report(written)
    if not written.skipped:
        warn_if_empty(found.domain, x)
    say_skipped(found.skipped, len(found.x))


class Found(NamedTuple):
    """Samples (N, ...), their domain, and (name, reason) of each that was skipped."""

    x: Any
    domain: Domain
    skipped: tuple[tuple[str, str], ...] = ()


def _found(
    source: Path, to: str | None, n: int | None, seed: int, trust: bool, size: int | None, coloured: bool = False
) -> Found:
    """Return the samples of a run, of an .npz that `unproject sample` wrote, or of folders of textures."""
    from .. import export
    from ..data import holds_materials
    from ..data.readers.arrays import load_arrays
    from ..domains import BUILT_IN, domain_of_arrays
    from ..training import load

    arrays_given = source.suffix.lower() == ".npz"
    of_materials = to is not None and SYNONYMS.get(to, to) in export.MATERIAL_FORMATS
    textures = of_materials or (to == "glb" and source.is_dir()) or holds_materials(source)
    textures = not arrays_given and textures
    if (source / "recipe.json").exists() or not (arrays_given or textures):
        opened = load(source, trust=trust)
        _refuse_coloured(source, coloured)
        return Found(opened.sample(_some(n), seed, size=size), opened.domain)
    arrays = load_arrays(source) if arrays_given else {}
    if textures or "diffuse" in arrays:
        maps, fresnel, skipped = read_maps(source, size, coloured)
        domain = replace(BUILT_IN["maps"], fresnel=fresnel)
        return Found(maps if n is None else maps[: _some(n)], domain, skipped)
    if size is not None:
        raise UserError(f"--size {size}: {source} has the size it was sampled at; give the run in its place")
    _refuse_coloured(source, coloured)
    domain = domain_of_arrays(arrays)
    return Found(_sampled_before(source, arrays, domain.name, _some(n)), domain)


def _refuse_coloured(source: Path, coloured: bool) -> None:
    if coloured:
        raise UserError(f"--coloured-specular: is for folders of textures, and {source} is none; leave it out")


def _count(n: int | None, only: tuple[int, ...]) -> int | None:
    """Return how many samples are drawn: those that are asked for, and at least those that are chosen.

    Raises:
        UserError: for numbers that are none of theirs, or that come twice.
    """
    if not only or n is not None and n < 1:
        return n
    if min(only) < 0 or len(set(only)) < len(only) or (n is not None and max(only) >= n):
        known = "0, 1, 2, …" if n is None else f"0 to {n - 1}"
        raise UserError(f"--only {' '.join(map(str, only))}: samples have the numbers {known}; give each once")
    return max(only) + 1 if n is None else n


def _chosen(found: Found, only: tuple[int, ...]) -> Found:
    if only and max(only) >= len(found.x):
        raise UserError(f"--only {max(only)}: there are {len(found.x)} samples, from 0 to {len(found.x) - 1}")
    return found._replace(x=found.x[list(only)]) if only else found


def _options(domain: Domain, to: str, faces: int | None, hull: bool, of_materials: dict[str, Any]) -> dict[str, Any]:
    """Return the options of an exporter.

    Raises:
        UserError: for those that the format does not take.
    """
    from .. import export

    if faces is not None and (to not in ("glb", "obj", "ply") or faces < 4):
        raise UserError(f"--faces {faces} with --to {to}: it is a number of triangles, at least 4, for glb, obj or ply")
    if hull and domain.name != "volume":
        raise UserError(f"--hull: only volumes have a hull, and this holds {domain.name}; leave it out")
    if to in export.MATERIAL_FORMATS:
        if "eta" in of_materials and of_materials.get("fresnel", getattr(domain, "fresnel", "eta")) != "eta":
            raise UserError(f"--eta {of_materials['eta']:g}: the specular map is the reflectance; add --fresnel eta")
        return of_materials
    if of_materials:
        (name, value), *_ = of_materials.items()
        formats = ", ".join(export.MATERIAL_FORMATS)
        raise UserError(f"--{name} {value}: is of materials ({formats}), and --to {to} has none; leave it out")
    options: dict[str, Any] = {} if faces is None else {"faces": faces}
    if to == "gif":
        from rich.progress import track

        options["track"] = lambda frames: track(frames, description="turntable")
    return options


SAMPLES = 16
"""How many are written unless it is said."""


def _some(n: int | None) -> int:
    if n is not None and n < 1:
        raise UserError(f"--n {n}: ask for at least one")
    return SAMPLES if n is None else n


def _hull(volumes: Any) -> Any:
    import torch

    from ..ops.hull import visual_hull

    return visual_hull(torch.as_tensor(volumes, dtype=torch.float32))


def _sampled_before(path: Path, arrays: Mapping[str, Any], name: str, n: int) -> Any:
    """Return the first samples of those that were stored, "volume" or "image", as float32.

    Raises:
        UserError: if there are none, or their values or axes are not those that `unproject sample` writes.
    """
    from ..data.readers.array_volumes import cubes
    from ..data.readers.arrays import checked_values
    from ..data.readers.found import to_floats, white_of

    if name not in arrays:
        raise UserError(f"{path}: holds no array {name!r}; use a file that `unproject sample` wrote")
    values = arrays[name]
    if name == "image" and (values.ndim != 4 or values.shape[1] not in (1, 3)):
        raise UserError(
            f"{path}: image is {values.dtype} {values.shape}; save (N, 1, H, W) or (N, 3, H, W), as `unproject sample`"
        )
    x = checked_values(values, f"{path}: {name}")
    x = cubes(path, name, x) if name == "volume" else x
    return to_floats(x[:n], white_of(x))


def _report(written: Written) -> None:
    for name, reason in written.skipped:
        print(printable(f"skipped {name}: {reason}"))
    first = written.paths[0]
    where = Path(os.path.commonpath([path.parent for path in written.paths]))
    several = f"{len(written.paths)} files in {where}"
    print(f"wrote {first if len(written.paths) == 1 else several}")
