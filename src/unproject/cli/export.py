"""`unproject export RUN --to FORMAT --n N --out PATH`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .._types import UserError

if TYPE_CHECKING:
    from numpy import ndarray

    from ..export import Written


def run(
    source: Path,
    /,
    *,
    out: Path,
    to: Literal["glb", "obj", "ply", "vox", "npz", "png", "gif"] = "glb",
    n: int = 16,
    seed: int = 0,
    faces: int | None = None,
    hull: bool = False,
    trust: bool = False,
) -> None:
    """Write new shapes of a run, or the shapes that `unproject sample` wrote.

    Args:
        source: A run directory, or an .npz of `unproject sample`.
        out: The file (with the format's suffix: one scene of all shapes) or the folder to write.
        to: glb, obj and ply are meshes, vox voxels, npz arrays, png a contact sheet and gif a turntable.
        n: The number of shapes.
        seed: Which shapes: the same seed draws the same ones.
        faces: The most triangles a mesh may have (glb, obj, ply).
        hull: Fill what no level view can see.
        trust: Import the generator's code although it is not of this package.
    """
    from .. import export

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


def _volumes(source: Path, n: int, seed: int, trust: bool) -> Any:
    if n < 1:
        raise UserError(f"--n {n}: ask for at least one shape")
    if source.suffix == ".npz":
        return _sampled_before(source)[:n]
    from ..training import load

    return load(source, trust).generator.sample(n, seed=seed)


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
