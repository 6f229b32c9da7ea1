"""`unproject export RUN --to FORMAT --n N --out PATH`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .._types import UserError
from ._materials import Materials, read_maps

if TYPE_CHECKING:
    from numpy import ndarray

    from ..export import Written


def run(
    source: Path,
    /,
    *,
    out: Path,
    to: Literal["glb", "obj", "ply", "vox", "npz", "png", "gif", "maps", "mtlx", "gltf"] = "glb",
    n: int | None = None,
    seed: int = 0,
    faces: int | None = None,
    hull: bool = False,
    depth: Literal["8", "16", "half", "float"] = "8",
    fresnel: Literal["eta", "albedo"] | None = None,
    eta: float = 1.5,
    size: int | None = None,
    trust: bool = False,
) -> None:
    """Write new shapes of a run, or the shapes or materials that `unproject sample` wrote.

    Args:
        source: A run directory, an .npz of `unproject sample`, or a folder of textures.
        out: The file (with the format's suffix: one scene of all shapes) or the folder to write.
        to: glb, obj and ply are meshes, vox voxels, npz arrays, png a contact sheet and gif a turntable. Of materials:
            maps are folders of PNG or EXR, mtlx the same with MaterialX, gltf a .glb of planes.
        n: How many; of a run 16 unless given, of a file or a folder of materials all.
        seed: Which shapes: the same seed draws the same ones.
        faces: The most triangles a mesh may have (glb, obj, ply).
        hull: Fill what no level view can see.
        depth: Bits of the maps' PNG, or half or float EXR.
        fresnel: What the specular map means: see `unproject render --help`.
        eta: The index of refraction, for --fresnel eta.
        size: Resample folders of textures to so many pixels a side.
        trust: Import the generator's code although it is not of this package.
    """
    from .. import export
    from ..training.run_directory import naming

    if to in export.MATERIAL_FORMATS:
        if faces is not None or hull:
            raise UserError(f"--to {to}: --faces and --hull are for shapes; leave them out")
        if to == "gltf" and out.suffix not in ("", ".glb"):
            raise UserError(f"--out {out}: give a name that ends in .glb, or a folder")
        found = _materials(source, n, seed, trust, size)
        write = export.MATERIAL_FORMATS[to]
        with naming(out):
            written = write(found.maps, out, depth=depth, fresnel=fresnel or found.fresnel, eta=eta)
        _report(written)
        return found.say_skipped()
    options = _options(to, faces)
    volumes = _volumes(source, n, seed, trust)
    _report(export.write(_hull(volumes) if hull else volumes, to, out, **options))


def _options(to: str, faces: int | None) -> dict[str, Any]:
    if faces is not None and (to not in ("glb", "obj", "ply") or faces < 4):
        raise UserError(f"--faces {faces} with --to {to}: it is a number of triangles, at least 4, for glb, obj or ply")
    options: dict[str, Any] = {} if faces is None else {"faces": faces}
    if to == "gif":
        from rich.progress import track

        options["track"] = lambda frames: track(frames, description="turntable")
    return options


def _volumes(source: Path, n: int | None, seed: int, trust: bool) -> Any:
    if source.suffix == ".npz":
        return _sampled_before(source)[: _some(n)]
    from ..training import load

    return load(source, trust).generator.sample(_some(n), seed=seed)


def _materials(source: Path, n: int | None, seed: int, trust: bool, size: int | None) -> Materials:
    """Maps of a run, of an .npz, or of folders of textures."""
    if not (source / "recipe.json").exists():
        found = read_maps(source, size)
        return found if n is None else found._replace(maps=found.maps[: _some(n)])
    from ..ops.maps import kind_of

    maps = _volumes(source, n, seed, trust)
    if kind_of(maps) != "maps":
        raise UserError(f"{source}: makes no materials; export shapes --to glb, obj, ply or vox, pictures --to png")
    return Materials(maps, "albedo")


def _some(n: int | None) -> int:
    if n is not None and n < 1:
        raise UserError(f"--n {n}: ask for at least one")
    return 16 if n is None else n


def _hull(volumes: Any) -> Any:
    import torch

    from ..ops.hull import visual_hull

    return visual_hull(torch.as_tensor(volumes, dtype=torch.float32))


def _sampled_before(path: Path) -> ndarray:
    import zipfile
    import zlib

    import numpy as np

    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return arrays["image" if "image" in arrays else "volume"]
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(
            f"{path} holds no `volume` array: use a file that `unproject sample` wrote ({error})"
        ) from error


def _report(written: Written) -> None:
    for name, reason in written.skipped:
        print(f"skipped {name}: {reason}")
    first = written.paths[0]
    several = f"{len(written.paths)} files in {first.parent}"
    print(f"wrote {first if len(written.paths) == 1 else several}")
