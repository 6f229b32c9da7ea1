"""
Shapes of a trained run
=======================

Chairs that were learned from silhouettes of unknown views: the run that comes with the package, 5,715 steps on one
processor by ``unproject train shapes --channels 32 --size 32 --minutes 24 --threads 1`` of 24 November 2026 (a639bfb),
an older default. ``put_example`` copies it to ``runs/example-chairs``.
"""

from pathlib import Path

import unproject as up
from unproject.cli import main

COMMAND = "unproject export runs/example-chairs --to png --n 2 --seed 1 --out runs/samples.png"

up.sharing.put_example("chairs", Path("runs"))
main(COMMAND.split()[1:])
