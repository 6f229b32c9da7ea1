"""
Shapes of a trained run
=======================

Chairs that were learned from silhouettes of unknown views: the run that comes with the package, 5,715 steps on one
processor. ``put_example`` copies it to ``runs/example-chairs``.
"""

from pathlib import Path

import unproject as up
from unproject.cli import main

COMMAND = "unproject export runs/example-chairs --to png --n 2 --seed 1 --out runs/samples.png"

up.sharing.put_example("chairs", Path("runs"))
main(COMMAND.split()[1:])
