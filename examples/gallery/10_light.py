"""
Light around a material
=======================

A floor of wood under a lamp that goes around it, seen from above and from 50° in turn, three times.
"""

from pathlib import Path

import numpy as np

import unproject as up
from unproject.cli import main
from unproject.ops.maps import unpack_maps

COMMAND = (
    "unproject render runs/wood.npz --view 50 --light directional:60 --fresnel albedo --strip 6 --out runs/lamp.png"
)

Path("runs").mkdir(exist_ok=True)
np.savez("runs/wood.npz", **{name: value.numpy() for name, value in unpack_maps(up.data.wood(1, 128, seed=1)).items()})
main(COMMAND.split()[1:])
