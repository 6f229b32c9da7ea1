"""
A turntable
===========

Samples of the same run while the camera goes round them. ``--to glb`` writes them as meshes.
"""

from pathlib import Path

import unproject as up
from unproject.cli import main

COMMAND = "unproject export runs/example-chairs --to gif --n 4 --seed 1 --out runs/turntable.gif"

up.sharing.put_example("chairs", Path("runs"))
main(COMMAND.split()[1:])
