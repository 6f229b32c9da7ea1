"""An assignment of your own: of each silhouette only the half turn is known, `front` or `back`, that it was taken from.

unproject check examples/own_assignment.py:observations
unproject train examples/own_assignment.py:halves --minutes 5 --out runs/halves
"""

from dataclasses import dataclass

import torch

import unproject as up
from unproject.assignment import views_of
from unproject.data import chairs, observe
from unproject.networks import LowRankGenerator
from unproject.projections.silhouette import azimuth_bins

observations = azimuth_bins(8, up.Silhouette(size=32))


@dataclass(frozen=True)
class FrontOrBack(up.Assignment):
    def heads(self, panel):
        return 2

    def begin(self, panel, seed):
        views = views_of(panel.collections[0], panel.observations)  # stands for what a person could tell
        return HalfKnown(panel, views, heads=((views + 2) % 8 >= 4).long())


class HalfKnown(up.AssignmentState):
    def project(self, x, rows, rng):
        within = torch.randint(4, (len(rows),), generator=rng)
        return self.observe(x, (4 * self.heads[rows] + within - 2) % 8, rng)


def halves(*, seed: int = 0) -> up.Recipe:
    """Chairs from silhouettes of which front or back is known: a discriminator with two heads."""
    panel = up.Panel(observations, observe(chairs(500), observations, each=8), FrontOrBack())
    return up.Recipe(LowRankGenerator, [panel], batch=32, views_per_sample=4, steps=1000, seed=seed)
