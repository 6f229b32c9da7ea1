"""Find real collections under `--data`, and write files that arms are trained on once, into a folder of the runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from torch import Tensor

from .._types import UserError
from ..data.readers.arrays import load_arrays
from ..domains import BUILT_IN, Domain

COLLECTIONS = {
    "mnist/{train,t10k}-images-idx3-ubyte.gz": "the digits, as they are published",
    "silhouettes/bird_cub_aves_64.npz": "masks of photographs of birds, (N, 64, 64)",
    "silhouettes/chair_ikea_64.npz": "masks of product photographs of chairs, (N, 64, 64)",
    "shapes3d/modelnet7_vox30_packbits.npz": "voxels of ModelNet, of which the chairs are taken",
    "shapes3d/cars_kenney_cc0_meshes.npz": "meshes: `name`, `verts`, `faces`, `vert_start`, `face_start`",
    "hdr/": "light probes, .hdr or .exr; every other one lights the training pictures",
    "materials/svbrdf/{wood,metal,plastic}/": "texture sets, a folder each",
    "materials/ambientcg_diffuse64_{wood,plastic}.npz": "further albedos, `albedo64` (N, 64, 64, 3), 8 bits, sRGB",
}
"""Path under `--data` → contents."""


@dataclass(frozen=True)
class Place:
    """Folders of the training data, and the size of the arms that need them.

    Attributes:
        folder: of files that are written.
        data: `--data`, the folder of real collections; None without.
        size: pixels or voxels a side.
    """

    folder: Path
    data: Path | None
    size: int

    def real(self, name: str) -> Path:
        """Return the path of a real collection.

        Raises:
            UserError: `--data` has no such file.
        """
        if self.data is None:
            raise UserError("this arm is trained on a real collection; give --data, the folder that holds it")
        path = self.data / name
        if not path.exists():
            raise UserError(f"{path}: is missing; --data is a folder with silhouettes/, shapes3d/, mnist/ and so on")
        return path

    def arrays(self, name: str, *keys: str) -> dict[str, np.ndarray]:
        """Return these arrays of an .npz of a real collection.

        Raises:
            UserError: as `real`, and for a file that does not hold them.
        """
        path = self.real(name)
        found = load_arrays(path)
        if missing := [key for key in keys if key not in found]:
            raise UserError(f"{path}: holds no {', '.join(missing)}; fetch it again")
        return {key: found[key] for key in keys}

    def once(self, name: str, make: Callable[[Path], None]) -> Path:
        """Return a file or folder, written by `make` if it does not exist; it appears whole or not at all.

        Its name tells of which `--data` it is.
        """
        if self.data is not None:
            stem, dot, suffix = name.partition(".")
            name = f"{stem}-{sha256(str(self.data.resolve()).encode()).hexdigest()[:6]}{dot}{suffix}"
        path = self.folder / name
        if path.exists():
            return path
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=f"unfinished-{path.name}-", dir=path.parent) as unfinished:
            made = Path(unfinished) / path.name
            make(made)
            if not path.exists():  # another process may have written the same meanwhile
                made.rename(path)
        return path


Flags = dict[str, Any]
Draw = Callable[[Place], Tensor]


@dataclass(frozen=True)
class Source:
    """Training data of an arm, and the reference of its scores.

    Attributes:
        flags: of the recipe, which name the training data.
        reference: true samples that no arm was trained on.
        others: further true samples, whose scores are those of a perfect generator; None where there are none.
        domain: of the samples (default: volumes).
        real: whether the samples are of a real collection. No picture of them is stored, for their licences' sake.
    """

    flags: Callable[[Place], Flags]
    reference: Draw
    others: Draw | None = None
    real: bool = False
    domain: Domain = BUILT_IN["volumes"]


def built_in(place: Place) -> Flags:
    """Return no flags: the recipe has an embedded data set."""
    return {}
