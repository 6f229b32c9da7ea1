"""Define what arms are trained on and scored against: procedural data sets, or the real collections of `--data`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from torch import Tensor

from ..data import Collection, birds, cars, chairs, digits, read
from ..data.readers.voxelise import normalised, voxelise
from ..domains import BUILT_IN
from .material_sources import SETS, photographed, procedural_materials
from .place import Draw, Flags, Place, Source, built_in

SHAPES, HELD_OUT = 1000, 512
NOT_CARS = ("kart", "tractor")


def procedural_shapes(make: Callable[..., Tensor], name: str) -> Source:
    """Return a procedural data set of shapes, written as an .npz."""

    def data(place: Place) -> Flags:
        def save(path: Path) -> None:
            with path.open("wb") as file:
                np.savez_compressed(file, volume=make(SHAPES, place.size, seed=0).numpy().astype(np.uint8))

        return {"data": place.once(f"{name}-{place.size}.npz", save)}

    return Source(data, *held_out(make))


def held_out(make: Callable[..., Tensor]) -> tuple[Draw, Draw]:
    """Return two draws of a procedural data set that no arm is trained on."""
    return lambda place: make(HELD_OUT, place.size, seed=1), lambda place: make(HELD_OUT, place.size, seed=2)


def real_collection(name: str, reference: str | None = None) -> Source:
    """Return a real collection; its reference is another part of it or, without `reference`, the collection itself."""
    scored = reference or name

    def training_data(place: Place) -> Tensor:
        return read(there(place, name), size=place.size).floats()

    def there(place: Place, what: str) -> str:
        path, colon, part = what.partition(":")
        return f"{place.real(path)}{colon}{part}"

    return Source(
        lambda place: {"data": Path(there(place, name))},
        lambda place: read(there(place, scored), size=place.size).floats(),
        training_data if reference else None,
        real=True,
    )


def mnist_pictures(place: Place, part: str) -> Path:
    return place.real(f"mnist/{part}-images-idx3-ubyte.gz")


def mnist(part: str) -> Draw:
    return lambda place: Collection.images(mnist_pictures(place, part), place.size).floats()


def mnist_flags(place: Place) -> Flags:
    mnist_pictures(place, "t10k")  # the reference of the scores: it must be there before training starts
    return {"data": mnist_pictures(place, "train")}


def car_volumes(place: Place) -> Path:
    """Return an .npz of solid voxels of the meshes that are cars."""

    def save(path: Path) -> None:
        keys = ("name", "verts", "faces", "vert_start", "face_start")
        arrays, volumes = place.arrays("shapes3d/cars_kenney_cc0_meshes.npz", *keys), []
        for k, name in enumerate(arrays["name"]):
            if not any(word in str(name) for word in NOT_CARS):
                points, corners = (slice(*arrays[f"{part}_start"][k : k + 2]) for part in ("vert", "face"))
                volumes.append(voxelise(normalised(arrays["verts"][points]), arrays["faces"][corners], place.size))
        with path.open("wb") as written:
            np.savez_compressed(written, volume=np.stack(volumes).astype(np.uint8))

    return place.once(f"cars-meshes-{place.size}.npz", save)


SOURCES: dict[str, Source] = {
    "chairs": Source(built_in, *held_out(chairs)),
    "birds": procedural_shapes(birds, "birds"),
    "cars": procedural_shapes(cars, "cars"),
    "chairs-modelnet": real_collection(
        "shapes3d/modelnet7_vox30_packbits.npz:chair", "shapes3d/modelnet7_vox30_packbits.npz:chair/test"
    ),
    "chairs-photographs": real_collection("silhouettes/chair_ikea_64.npz"),
    "birds-photographs": real_collection("silhouettes/bird_cub_aves_64.npz"),
    "cars-meshes": Source(
        lambda place: {"data": car_volumes(place)},
        lambda place: read(car_volumes(place), size=place.size).floats(),
        real=True,
    ),
    "digits": Source(
        built_in,
        lambda place: digits(place.size, held_out=True),
        lambda place: digits(place.size),
        domain=BUILT_IN["images"],
    ),
    "mnist": Source(mnist_flags, mnist("t10k"), mnist("train"), real=True, domain=BUILT_IN["images"]),
    **{name: procedural_materials(name) for name in ("wood", "correlated")},
    **{name: photographed(name) for name in ("metal", "plastic")},
    **{f"{name}-real": photographed(name, real=True) for name in ("metal", "plastic")},
    **{name: photographed(name, real=True) for name in SETS},
}
"""Name → source."""
