"""Pivotal tuning: a generator's own weights are trained for some pictures, from the latent that was found on.

References:
    Roich et al. 2021, Pivotal tuning for latent-based editing of real images.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import torch
from torch import Tensor

from .candidates import Candidates
from .search import Search
from .viewing import Latents


def tuned(candidates: Candidates, search: Search, v: Tensor, theta: Latents, pictures: Tensor) -> Tensor:
    """Return the sample (1, ...) of v (1, r) by a copy of the generator that was trained for these pictures.

    Args:
        theta: latents of the views, (1, M) by name.
        pictures: (M, ...).
    """
    own = replace(candidates, generator=copy.deepcopy(candidates.generator).requires_grad_(True))
    own.__dict__.update(space=candidates.space, variance=candidates.variance)  # of the generator as it was
    adam = torch.optim.Adam(own.generator.parameters(), lr=search.tune_rate, betas=(0.9, 0.99))
    for _ in range(search.tune):
        distance = own.distance(own.project(own.synthesise(v), theta, len(pictures)), pictures)
        adam.zero_grad()
        distance.sum().backward()
        adam.step()
    with torch.no_grad():
        return own.synthesise(v)
