"""Define the materials that arms are trained on and scored against: procedural ones, and patches of real sets."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ..data import Collection, material_patches, mixed_probes, observe, read_probes
from ..domains import BUILT_IN
from ..export.materials import to_srgb
from ..ops.maps import MAPS
from ..recipes.material_panels import observation_of
from ..recipes.materials import PROCEDURAL
from .place import Draw, Flags, Place, Source, built_in

MATERIALS = 500
UNSEEN = 2**41
"""Seed of the reference materials; `unproject evaluate` has 2**40, on which recipes were chosen."""
PICTURES = 5 * 10**4
"""Seed of the photographed materials."""
PHOTOGRAPHED = {
    "metal": (1000, 5000),
    "plastic": (1000, 5000),
    "wood-real": (2000, 2000),
    "metal-sets": (1000, 2000),
    "plastic-sets": (1000, 2000),
}
"""Number of pictures of each map, and of photographs of each kind."""
SETS = {"wood-real": "wood", "metal-sets": "metal", "plastic-sets": "plastic"}
"""Sources of patches of real texture sets, and the folder of each."""
ALBEDOS = ("wood", "plastic")
"""Kinds with further albedos as diffuse maps; a metal has none."""
PROBES = 48
"""Procedural probes where none are real; half of them are for training."""


def procedural_materials(name: str) -> Source:
    """Return a procedural data set of materials."""
    return Source(built_in, *two_draws(lambda place: partial(_procedural, name, place.size)), domain=BUILT_IN["maps"])


Materials = Callable[[int, int], Tensor]
"""(count, seed) → maps (count, 8, size, size)."""


def two_draws(materials: Callable[[Place], Materials]) -> tuple[Draw, Draw]:
    return lambda place: materials(place)(MATERIALS, UNSEEN), lambda place: materials(place)(MATERIALS, UNSEEN + 1)


def _procedural(name: str, size: int, count: int, seed: int) -> Tensor:
    return PROCEDURAL[name](count, size, seed)


def photographed(name: str, real: bool = False) -> Source:
    """Return maps, and renderings that replace photographs, under light not used in training, as folders of PNGs.

    Args:
        name: of a procedural data set, or a key of `SETS`.
        real: whether the light is that of real probes.
    """

    def data(place: Place) -> Flags:
        training, photographs = _probes(place, real)
        materials = _materials(name, place)

        def make(path: Path) -> None:
            _photograph(path, name, materials, photographs)
            if SETS.get(name) in ALBEDOS:
                _add_albedos(path, SETS[name], place)

        lit = "real" if real else "mixed"
        pictures = place.once(f"pictures-{name}-{lit}-light-{place.size}", make)
        return {"data": pictures, "probes": place.once(f"probes-{lit}", lambda path: _save_probes(path, training))}

    return Source(data, *two_draws(partial(_materials, name)), real=name in SETS, domain=BUILT_IN["maps"])


def _probes(place: Place, real: bool) -> tuple[Tensor, Tensor]:
    """Return the probes of training and those of the photographs: every other one, so that none is in both."""
    every = read_probes(place.real("hdr"), 32)[0] if real else mixed_probes(PROBES, 32)
    return every[::2], every[1::2]


def _save_probes(folder: Path, probes: Tensor) -> None:
    folder.mkdir()
    for k, probe in enumerate(probes):
        np.save(folder / f"{k:02d}.npy", probe.permute(1, 2, 0).numpy())


def _materials(name: str, place: Place) -> Materials:
    if name in PROCEDURAL:
        return partial(_procedural, name, place.size)
    folder = place.real(f"materials/svbrdf/{SETS[name]}")
    sets = Collection.materials(folder, 4 * place.size).warn_skipped().floats()
    turn = 0.1 if SETS[name] == "wood" else math.pi  # keeps the grain upright
    return lambda count, seed: material_patches(sets, count, place.size, seed, turn=turn)


def _photograph(folder: Path, name: str, materials: Materials, light: Tensor) -> None:
    """Write a folder for each observation, as `--data` takes them; no two pictures show the same material."""
    encoded = {
        "diffuse": lambda c: torch.from_numpy(to_srgb(c.numpy())),
        "roughness": torch.sqrt,
        "normal": lambda n: n / 2 + 0.5,
        "specular": lambda s: s,
    }
    maps, renderings = PHOTOGRAPHED[name]
    for k, one in enumerate(MAPS):
        _write(folder / one, encoded[one](materials(maps, PICTURES + k)[:, MAPS[one]]))
    for k, view in enumerate(("top", "grazing")):
        pictures = observe(materials(renderings, PICTURES + 10 + k), [observation_of(view, light, 64)], seed=k)
        _write(folder / view, pictures.items)


def _add_albedos(folder: Path, kind: str, place: Place) -> None:
    """Write the albedos of 246 CC0 woods or 29 plastics as diffuse maps."""
    albedos = place.arrays(f"materials/ambientcg_diffuse64_{kind}.npz", "albedo64")["albedo64"]
    for k, albedo in enumerate(albedos):
        Image.fromarray(albedo).save(folder / "diffuse" / f"albedo-{k:03d}.png")


def _write(folder: Path, values: Tensor) -> None:
    """Write PNGs, colours and normals in 8 bits, grey maps in 16: a specular albedo of 0.04 is ten steps of 8 bits."""
    folder.mkdir(parents=True)
    for k, image in enumerate(values.clamp(0, 1).numpy()):
        grey = len(image) == 1
        pixels = (image[0] * 65535 + 0.5).astype(np.uint16) if grey else (image * 255 + 0.5).astype(np.uint8)
        Image.fromarray(pixels if grey else np.moveaxis(pixels, 0, 2)).save(folder / f"{k:05d}.png")
