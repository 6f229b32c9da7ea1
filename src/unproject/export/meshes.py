"""Triangle meshes: closed, right side out, +y up, in the units of the volume ([-1, 1]³).

Formats: glTF binary (.glb: Blender, Unity, Unreal, the web), Wavefront .obj and .ply.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from unproject._types import UserError
from unproject.export._volumes import Written, as_batch, floor_grid, is_file, keep_usable, names_for, save, warn_left
from unproject.ops.isosurface import isosurface, without_cavities

if TYPE_CHECKING:  # trimesh is imported where it is used: it takes as long as a third of torch, and samplers need none
    import trimesh
    from trimesh.visual.material import PBRMaterial

# Linear, as glTF wants it.
CLAY = (0.62, 0.43, 0.32)
# A volume is two units wide.
_SPACING = 2.5
MOST_TRIED = 4_000_000
"""Triangles that decimation looks at in all its attempts at a step, some thirty seconds."""


def mesh(
    volume: ArrayLike,
    *,
    level: float = 0.5,
    smooth: int = 6,
    min_fraction: float = 0.02,
    largest: bool = False,
    faces: int | None = None,
    name: str = "the shape",
) -> trimesh.Trimesh:
    """The closed surface of one (X, Y, Z) volume, smooth-shaded, in matte clay.

    Args:
        level: the occupancy on the surface.
        smooth: rounds of smoothing against voxel steps; 0 keeps the steps.
        min_fraction: loose parts smaller than this part of the largest are dropped; hollows are filled.
        largest: all parts but the largest are dropped.
        faces: a budget of triangles; if no closed mesh of so few is found there are more, and a warning says so.
        name: how an error calls the shape.

    Raises:
        UserError: nothing lies above the level.
    """
    import trimesh
    from trimesh.visual import TextureVisuals

    v = as_batch(volume)[0]
    solid, parts = without_cavities(v, level), {"min_fraction": min_fraction, "largest": largest}
    vertices, triangles = isosurface(solid, level, smooth=smooth, **parts)
    if len(triangles) == 0:
        raise UserError(
            f"{name} is empty: its highest occupancy is {v.max():.2f} and the surface lies at {level}; "
            "train longer, or sample another seed"
        )
    surface = _decimated(trimesh.Trimesh(vertices, triangles, process=False), faces, name)
    surface.visual = TextureVisuals(material=_clay())
    return surface


def glb(
    volumes: ArrayLike, path: str | PathLike[str], *, names: Sequence[str] | None = None, **options: Any
) -> Written:
    """glTF binary. A path ending in .glb becomes one scene with a node for each shape, laid out in rows on the
    floor around the origin; any other path becomes a folder with a file for each shape.

    Args:
        volumes: (N, X, Y, Z) or (X, Y, Z), a tensor or an array.
        names: of the nodes or files; shape_00, shape_01, ... if left out.
        options: those of `mesh`.

    Raises:
        UserError: no shape has a surface. OSError: the disk. Empty shapes among others are in `Written.skipped`.
    """
    return _write(volumes, path, ".glb", _glb_bytes, names, options)


def obj(
    volumes: ArrayLike, path: str | PathLike[str], *, names: Sequence[str] | None = None, **options: Any
) -> Written:
    """Wavefront, with normals and without material: one file (an object for each shape) or a folder, as `glb`."""
    return _write(volumes, path, ".obj", _obj_text, names, options)


def ply(
    volumes: ArrayLike, path: str | PathLike[str], *, names: Sequence[str] | None = None, **options: Any
) -> Written:
    """Binary PLY with normals: one file (all shapes in one mesh) or a folder, as `glb`."""
    return _write(volumes, path, ".ply", _ply_bytes, names, options)


def _write(
    volumes: ArrayLike,
    path: str | PathLike[str],
    suffix: str,
    encode: Callable[[trimesh.Scene], bytes | str],
    names: Sequence[str] | None,
    options: dict[str, Any],
) -> Written:
    batch, path, numbered = as_batch(volumes), Path(path), names is None
    names = names_for(batch, names)
    meshes, skipped = keep_usable(names, lambda i: mesh(batch[i], name=names[i], **options))
    if is_file(path, suffix):
        return Written((save(path, encode(_scene(meshes))),), skipped)
    files = tuple(save(path / f"{name}{suffix}", encode(_scene({name: m}))) for name, m in meshes.items())
    if numbered:  # chosen ones may be put beside others
        warn_left(path, {file.name for file in files}, rf"shape_\d+\{suffix}")
    return Written(files, skipped)


def _scene(meshes: dict[str, trimesh.Trimesh]) -> trimesh.Scene:
    import trimesh

    scene = trimesh.Scene()
    for (name, surface), (x, z) in zip(meshes.items(), floor_grid(len(meshes), _SPACING), strict=True):
        place = trimesh.transformations.translation_matrix([x, 0, z])
        scene.add_geometry(surface, node_name=name, geom_name=name, transform=place)
    return scene


def _placed(scene: trimesh.Scene) -> dict[str, trimesh.Trimesh]:
    """Each node's mesh in the coordinates of the scene, for formats that have no nodes."""
    return {n: scene.geometry[n].copy().apply_transform(scene.graph[n][0]) for n in scene.graph.nodes_geometry}


def _obj_text(scene: trimesh.Scene) -> str:
    lines, first = ["# unproject: y up, object in [-1, 1]"], 1
    for name, surface in _placed(scene).items():
        lines.append(f"o {name}")
        lines += [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in surface.vertices]
        lines += [f"vn {x:.5f} {y:.5f} {z:.5f}" for x, y, z in surface.vertex_normals]
        lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in surface.faces + first]
        first += len(surface.vertices)
    return "\n".join(lines) + "\n"


def _ply_bytes(scene: trimesh.Scene) -> bytes:
    import trimesh

    joined: Any = trimesh.util.concatenate(list(_placed(scene).values()))
    return joined.export(file_type="ply", vertex_normal=True, include_attributes=False)


def _glb_bytes(scene: trimesh.Scene) -> bytes:
    content: Any = scene.export(file_type="glb", include_normals=True)
    return content


def _decimated(surface: trimesh.Trimesh, faces: int | None, name: str) -> trimesh.Trimesh:
    """At most `faces` triangles, by quadric edge collapse in several steps if one opens the mesh; more if all do."""
    while faces is not None and faces < len(surface.faces):
        smaller = _collapsed(surface, faces)
        if smaller is None:
            kept = f"{name} keeps {len(surface.faces)} triangles"
            warnings.warn(f"{kept}: no smaller closed mesh was found", stacklevel=3)
            return surface
        surface = smaller
    return surface


def _collapsed(surface: trimesh.Trimesh, faces: int) -> trimesh.Trimesh | None:
    """A smaller mesh that is as closed, of at most so many triangles if one is found.

    Whether collapses open or fold a mesh is a matter of their order, which the library's aggressiveness changes. Of
    large meshes fewer orders are tried.
    """
    import fast_simplification  # only those who ask for a budget pay for it
    import trimesh

    points, triangles = np.asarray(surface.vertices, np.float32), np.asarray(surface.faces, np.int32)
    ways = [(share, aggressiveness) for aggressiveness in (7, 5, 10, 3) for share in (1.0, 0.5, 0.1)]
    for share, aggressiveness in ways[: max(1, MOST_TRIED // len(triangles))]:  # a share of the way there
        target = int(len(triangles) ** (1 - share) * faces**share)
        found = fast_simplification.simplify(points, triangles, target_count=target, agg=aggressiveness)
        smaller = trimesh.Trimesh(*found, process=False)
        if len(smaller.faces) < len(triangles) and _is_closed(smaller) and smaller.body_count == surface.body_count:
            return smaller
    return None


def _is_closed(surface: trimesh.Trimesh) -> bool:
    with np.errstate(all="ignore"):  # of triangles without area
        return bool(surface.is_watertight and surface.is_winding_consistent and surface.volume > 0)


def _clay() -> PBRMaterial:
    from trimesh.visual.material import PBRMaterial

    return PBRMaterial(name="clay", baseColorFactor=[*CLAY, 1.0], metallicFactor=0.0, roughnessFactor=0.85)
