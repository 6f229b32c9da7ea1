"""What arms learn from, and what they are scored against: embedded worlds, or the real collections of `--data`.

Files that have to be written first, such as photographs of metal, are written once, into a folder of the runs.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from .._types import UserError
from ..data import (
    Collection,
    birds,
    cars,
    chairs,
    digits,
    material_patches,
    mixed_probes,
    observe,
    read,
    read_probes,
)
from ..data.readers.voxelise import normalised, voxelise
from ..export.materials import to_srgb
from ..ops.maps import MAPS
from ..recipes.materials import WORLDS, way_of

SHAPES, HELD_OUT, MATERIALS = 1000, 512, 500
UNSEEN = 2**41
"""Seed of the materials arms are scored against; `unproject evaluate` takes 2**40, on which recipes were chosen."""
PICTURES = 5 * 10**4  # seeds of what is photographed
PHOTOGRAPHED = {
    "metal": (1000, 5000),
    "plastic": (1000, 5000),
    "wood-real": (2000, 2000),
    "metal-sets": (1000, 2000),
    "plastic-sets": (1000, 2000),
}
"""How many pictures of each map, and photographs of each kind."""
SETS = {"wood-real": "wood", "metal-sets": "metal", "plastic-sets": "plastic"}
"""Sources that are patches of real texture sets, and the folder of these."""
ALBEDOS = ("wood", "plastic")
"""Of which further albedos are diffuse maps; a metal has none."""
PROBES = 48  # made, where light is not real: half of them for training
NOT_CARS = ("kart", "tractor")


COLLECTIONS = {
    "mnist/{train,t10k}-images-idx3-ubyte.gz": "the digits, as they are published",
    "silhouettes/bird_cub_aves_64.npz": "masks of photographs of birds, (N, 64, 64)",
    "silhouettes/chair_ikea_64.npz": "masks of product photographs of chairs, (N, 64, 64)",
    "shapes3d/modelnet7_vox30_packbits.npz": "voxels of ModelNet, of which the chairs are taken",
    "shapes3d/cars_kenney_cc0_meshes.npz": "meshes: `name`, `verts`, `faces`, `vert_start`, `face_start`",
    "hdr/": "light probes, .hdr or .exr; every other one lights what is photographed",
    "materials/svbrdf/{wood,metal,plastic}/": "texture sets, a folder each",
    "materials/ambientcg_diffuse64_{wood,plastic}.npz": "further albedos, `albedo64` (N, 64, 64, 3), 8 bits, sRGB",
}
"""What `--data` may hold, and what it is."""


@dataclass(frozen=True)
class Place:
    """Where files are written, the real collections if there are any, and the side of things."""

    folder: Path
    data: Path | None
    size: int

    def real(self, name: str) -> Path:
        """Raises UserError if `--data` has no such file."""
        if self.data is None:
            raise UserError("this arm learns from real pictures; give --data, the folder that holds them")
        path = self.data / name
        if not path.exists():
            raise UserError(f"{path}: is missing; --data is a folder with silhouettes/, shapes3d/, mnist/ and so on")
        return path

    def once(self, name: str, make: Callable[[Path], None]) -> Path:
        """A file or folder, made if it is not there yet; never half made."""
        path = self.folder / name
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished = path.with_name(f"unfinished-{os.getpid()}-{path.name}")
            shutil.rmtree(unfinished, ignore_errors=True)
            make(unfinished)
            if not path.exists():  # another process may have made it meanwhile: the same
                unfinished.rename(path)
        return path


Flags = dict[str, Any]
Draw = Callable[[Place], Tensor]


@dataclass(frozen=True)
class Source:
    """What an arm learns from and is scored against.

    Attributes:
        flags: of the recipe, which name what to learn from.
        reference: true things that no arm has seen.
        others: other true things, whose scores are what a perfect generator would get; None where there are no more.
        real: whether they are of a real collection, of which no picture is kept: it is not ours to hand on.
    """

    flags: Callable[[Place], Flags]
    reference: Draw
    others: Draw | None = None
    real: bool = False


def built_in(place: Place) -> Flags:
    """Nothing to name: the recipe has its own world."""
    return {}


def family(make: Callable[..., Tensor], name: str) -> Source:
    """A procedural family of shapes, written as an .npz."""

    def data(place: Place) -> Flags:
        def save(path: Path) -> None:
            with path.open("wb") as file:
                np.savez_compressed(file, volume=make(SHAPES, place.size, seed=0).numpy().astype(np.uint8))

        return {"data": place.once(f"{name}-{place.size}.npz", save)}

    return Source(data, *held_out(make))


def held_out(make: Callable[..., Tensor]) -> tuple[Draw, Draw]:
    """Two draws of a family that no arm has seen."""
    return lambda place: make(HELD_OUT, place.size, seed=1), lambda place: make(HELD_OUT, place.size, seed=2)


def file(name: str, reference: str | None = None) -> Source:
    """A real collection; scored against another part of it, or, if there is none, against itself."""
    kept = reference or name

    def learned_from(place: Place) -> Tensor:
        return read(there(place, name), size=place.size).floats()

    def there(place: Place, what: str) -> str:
        path, colon, part = what.partition(":")
        return f"{place.real(path)}{colon}{part}"

    return Source(
        lambda place: {"data": Path(there(place, name))},
        lambda place: read(there(place, kept), size=place.size).floats(),
        learned_from if reference else None,
        real=True,
    )


def mnist_pictures(place: Place, part: str) -> Path:
    return place.real(f"mnist/{part}-images-idx3-ubyte.gz")


def mnist(part: str) -> Draw:
    return lambda place: Collection.images(mnist_pictures(place, part), place.size).floats()


def mnist_flags(place: Place) -> Flags:
    mnist_pictures(place, "t10k")  # scored against: better missed now than after the training
    return {"data": mnist_pictures(place, "train")}


def car_volumes(place: Place) -> Path:
    """Solid voxels of the meshes that are cars."""

    def save(path: Path) -> None:
        with np.load(place.real("shapes3d/cars_kenney_cc0_meshes.npz"), allow_pickle=False) as meshes:
            arrays = {name: meshes[name] for name in meshes.files}
        volumes = []
        for k, name in enumerate(arrays["name"]):
            if not any(word in str(name) for word in NOT_CARS):
                points, corners = (slice(*arrays[f"{part}_start"][k : k + 2]) for part in ("vert", "face"))
                volumes.append(voxelise(normalised(arrays["verts"][points]), arrays["faces"][corners], place.size))
        with path.open("wb") as written:
            np.savez_compressed(written, volume=np.stack(volumes).astype(np.uint8))

    return place.once(f"cars-meshes-{place.size}.npz", save)


def world(name: str) -> Source:
    """A procedural world of materials."""
    return Source(built_in, *two_draws(lambda place: partial(_of_world, name, place.size)))


Materials = Callable[[int, int], Tensor]
"""(count, seed) → maps (count, 8, size, size)."""


def two_draws(materials: Callable[[Place], Materials]) -> tuple[Draw, Draw]:
    return lambda place: materials(place)(MATERIALS, UNSEEN), lambda place: materials(place)(MATERIALS, UNSEEN + 1)


def _of_world(name: str, size: int, count: int, seed: int) -> Tensor:
    return WORLDS[name](count, size, seed)


def photographed(name: str, real: bool = False) -> Source:
    """Maps, and renderings that stand in for photographs, lit as training is not, as folders of PNGs.

    Args:
        name: of a world; or one of `SETS`.
        real: whether real probes light them.
    """

    def data(place: Place) -> Flags:
        ours, theirs = _probes(place, real)
        things = _materials(name, place)

        def make(path: Path) -> None:
            _photograph(path, name, things, theirs)
            if SETS.get(name) in ALBEDOS:
                _add_albedos(path, SETS[name], place)

        lit = "real" if real else "mixed"
        pictures = place.once(f"pictures-{name}-{lit}-light-{place.size}", make)
        return {"data": pictures, "probes": place.once(f"probes-{lit}", lambda path: _save_probes(path, ours))}

    return Source(data, *two_draws(partial(_materials, name)), real=name in SETS)


def _probes(place: Place, real: bool) -> tuple[Tensor, Tensor]:
    """Light for training and light of the photographs: every other probe, so that none is in both."""
    every = read_probes(place.real("hdr"), 32)[0] if real else mixed_probes(PROBES, 32)
    return every[::2], every[1::2]


def _save_probes(folder: Path, probes: Tensor) -> None:
    folder.mkdir()
    for k, probe in enumerate(probes):
        np.save(folder / f"{k:02d}.npy", probe.permute(1, 2, 0).numpy())


def _materials(name: str, place: Place) -> Materials:
    if name in WORLDS:
        return partial(_of_world, name, place.size)
    sets = Collection.materials(place.real(f"materials/svbrdf/{SETS[name]}"), 4 * place.size).warn_skipped().items
    turn = 0.1 if SETS[name] == "wood" else math.pi  # grain goes up and down
    return lambda count, seed: material_patches(sets, count, place.size, seed, turn=turn)


def _photograph(folder: Path, name: str, things: Materials, light: Tensor) -> None:
    """A folder a way of looking, as `--data` takes them; no two pictures are of one material."""
    encoded = {
        "diffuse": lambda c: torch.from_numpy(to_srgb(c.numpy())),
        "roughness": torch.sqrt,
        "normal": lambda n: n / 2 + 0.5,
        "specular": lambda s: s,
    }
    maps, renderings = PHOTOGRAPHED[name]
    for k, one in enumerate(MAPS):
        _write(folder / one, encoded[one](things(maps, PICTURES + k)[:, MAPS[one]]))
    for k, look in enumerate(("top", "grazing")):
        seen = observe(things(renderings, PICTURES + 10 + k), [way_of(look, light, 64)], seed=k)
        _write(folder / look, seen.items)


def _add_albedos(folder: Path, kind: str, place: Place) -> None:
    """The albedos at hand, of 246 CC0 woods or 29 plastics, as diffuse maps."""
    with np.load(place.real(f"materials/ambientcg_diffuse64_{kind}.npz"), allow_pickle=False) as albedos:
        for k, albedo in enumerate(albedos["albedo64"]):
            Image.fromarray(albedo).save(folder / "diffuse" / f"albedo-{k:03d}.png")


def _write(folder: Path, values: Tensor) -> None:
    """Colours and normals in 8 bits, grey maps in 16: a specular albedo of 0.04 is ten steps of 8 bits."""
    folder.mkdir(parents=True)
    for k, image in enumerate(values.clamp(0, 1).numpy()):
        grey = len(image) == 1
        pixels = (image[0] * 65535 + 0.5).astype(np.uint16) if grey else (image * 255 + 0.5).astype(np.uint8)
        Image.fromarray(pixels if grey else np.moveaxis(pixels, 0, 2)).save(folder / f"{k:05d}.png")


SOURCES: dict[str, Source] = {
    "chairs": Source(built_in, *held_out(chairs)),
    "birds": family(birds, "birds"),
    "cars": family(cars, "cars"),
    "chairs-modelnet": file(
        "shapes3d/modelnet7_vox30_packbits.npz:chair", "shapes3d/modelnet7_vox30_packbits.npz:chair/test"
    ),
    "chairs-photographs": file("silhouettes/chair_ikea_64.npz"),
    "birds-photographs": file("silhouettes/bird_cub_aves_64.npz"),
    "cars-meshes": Source(
        lambda place: {"data": car_volumes(place)},
        lambda place: read(car_volumes(place), size=place.size).floats(),
        real=True,
    ),
    "digits": Source(built_in, lambda place: digits(place.size, held_out=True), lambda place: digits(place.size)),
    "mnist": Source(mnist_flags, mnist("t10k"), mnist("train"), real=True),
    **{name: world(name) for name in ("wood", "correlated")},
    **{name: photographed(name) for name in ("metal", "plastic")},
    **{f"{name}-real": photographed(name, real=True) for name in ("metal", "plastic")},
    **{name: photographed(name, real=True) for name in SETS},
}
"""By name."""
