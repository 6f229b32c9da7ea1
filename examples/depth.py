"""A projection of your own: learn chairs from depth images whose azimuth is unknown.

unproject check examples/depth.py:depth
unproject train examples/depth.py:scans --minutes 5 --out runs/scans
"""

import math
from functools import partial

import unproject as up
from unproject.data import chairs, observe
from unproject.networks import LowRankGenerator


class Depth(up.Projection):
    """Front-most depth of a volume turned by `azimuth` (radians) about the up axis."""

    def forward(self, x, *, azimuth):
        return up.ops.expected_depth(up.ops.rotate_y(x, azimuth)) / 2 + 0.5


depth = up.Observation("depth", Depth(), up.Uniform("azimuth", 0, 2 * math.pi))


def scans(*, seed: int = 0) -> up.Recipe:
    """Chairs from depth images of unknown azimuth, with one discriminator head.

    Args:
        seed: of everything random.
    """
    panel = up.Panel([depth], observe(chairs(500), [depth], each=4))
    return up.Recipe(partial(LowRankGenerator, size=32), [panel], steps=1000, seed=seed)
