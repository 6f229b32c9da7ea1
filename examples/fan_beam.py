"""A scanner of your own: learn images from fan-beam line integrals, as X-ray tubes and rows of detectors measure them.

unproject check examples/fan_beam.py:FanBeam
unproject train examples/fan_beam.py:scanner --minutes 5 --out runs/scanner
"""

import math

import torch
import torch.nn.functional as F

import unproject as up
from unproject.assignment import by_view
from unproject.data import digits as images
from unproject.data import observe
from unproject.recipes.digits import digits


class FanBeam(up.Projection):
    """Integrals from a source at `angle` (radians), 1.5 image widths from the centre, to an arc of 32 detectors."""

    linear, example_shape = True, (1, 16, 16)

    def forward(self, x, *, angle):
        t = torch.linspace(3 - math.sqrt(2), 3 + math.sqrt(2), 64).to(x)  # along a ray; the image is 2 wide
        ray = angle[:, None] + torch.linspace(-0.35, 0.35, 32).to(x)
        right = 3 * angle.cos()[:, None, None] - t * ray.cos()[..., None]
        up_ = 3 * angle.sin()[:, None, None] - t * ray.sin()[..., None]
        return F.grid_sample(x, torch.stack([right, -up_], -1), align_corners=False).mean(3) * math.sqrt(2)


def scanner(*, seed: int = 0, steps: int = 3000) -> up.Recipe:
    """The recipe `digits` with this scanner at twelve known positions around: one discriminator with twelve heads."""
    scan, positions = FanBeam(), up.Bins("angle", 12).parts  # one projection, which all observations share
    observations = [up.Observation(f"source-{k}", scan, position) for k, position in enumerate(positions)]
    lines = observe(images(32), observations, each=4, chunk=500)
    return digits(seed=seed, steps=steps, batch=64).replace(panels=[up.Panel(*by_view(lines, observations))])
