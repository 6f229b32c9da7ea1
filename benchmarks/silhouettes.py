"""Silhouettes at 64³, batch 16, forward + backward: the fast path against the released algorithm, tilted against level.

The released algorithm written plainly: 96 trilinear samples a ray by 3-D `grid_sample`, then the occupancy rule.
The two take turns in one run on one thread, timed in CPU seconds, so that other work on the machine slows both
alike; the figure is the ratio of the medians. Tilted views, each with an elevation of its own, and photographs, with a
perspective and a roll too, are measured against level ones likewise.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from unproject._random import generator_at
from unproject.projections.silhouette import RULES, Silhouette

SIZE, BATCH, DEPTHS, REPEATS = 64, 16, 96, 5


def released(x: Tensor, azimuth: Tensor, rule: str) -> Tensor:
    """(B, X, Y, Z) → (B, 1, S, S): viewport 1, depth 0 … 3 from a camera at distance 1.5, one sample a voxel."""
    u = (torch.arange(SIZE) + 0.5) / SIZE * 2 - 1
    w = -((torch.arange(DEPTHS) + 0.5) / DEPTHS * 2 - 1) * 1.5
    up, right, near = torch.meshgrid(-u, u, w, indexing="ij")
    c, s = azimuth.cos().view(-1, 1, 1, 1), azimuth.sin().view(-1, 1, 1, 1)
    grid = torch.stack((near * c - right * s, up.expand(len(x), -1, -1, -1), right * c + near * s), -1)
    p = F.grid_sample(x.unsqueeze(1), grid, align_corners=False)
    if rule == "any":
        return 1 - (1 - p).prod(-1)
    if rule == "alpha":
        return torch.where(p.cumsum(-1) <= 1 + 1e-4, p, 0).sum(-1)
    return 1 - (-p.sum(-1)).exp()


def run() -> dict[str, dict[str, float]]:
    """rule → CPU seconds of both (medians), their ratio, and the largest difference of values and of gradients.

    "tilted, …" and "photographs, absorption" → CPU seconds of level and these views, and the ratio of these to level.
    """
    x = (torch.rand(BATCH, SIZE, SIZE, SIZE, generator=generator_at(0)) ** 8).contiguous()
    azimuth = torch.rand(BATCH, generator=generator_at(1)) * 2 * math.pi
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return (
            {rule: compare(x, azimuth, rule) for rule in RULES}
            | {f"tilted, {rule}": compare_tilted(x, azimuth, rule) for rule in RULES}
            | {"photographs, absorption": compare_tilted(x, azimuth, "absorption", in_perspective=True)}
        )
    finally:
        torch.set_num_threads(threads)


def compare(x: Tensor, azimuth: Tensor, rule: str) -> dict[str, float]:
    looks: tuple[Callable[[Tensor], Tensor], ...] = (
        lambda v: released(v, azimuth, rule),
        lambda v: Silhouette(rule=rule)(v, azimuth=azimuth),
    )
    (plain, plain_gradient), (quick, quick_gradient) = (step(look, x)[1:] for look in looks)
    times = [[step(look, x)[0] for look in looks] for _ in range(REPEATS)]
    released_seconds, fast_seconds = (statistics.median(column) for column in zip(*times))
    return {
        "released_seconds": released_seconds,
        "fast_seconds": fast_seconds,
        "ratio": released_seconds / fast_seconds,
        "value_difference": (plain - quick).abs().max().item(),
        "gradient_difference": (plain_gradient - quick_gradient).abs().max().item(),
    }


def compare_tilted(x: Tensor, azimuth: Tensor, rule: str, in_perspective: bool = False) -> dict[str, float]:
    elevation, perspective, roll = (torch.rand(3, len(x), generator=generator_at(2)) - 0.5) * math.pi
    photograph = {"perspective": (perspective / math.pi + 0.5) * 0.45, "roll": roll / 5} if in_perspective else {}
    looks: tuple[Callable[[Tensor], Tensor], ...] = (
        lambda v: Silhouette(rule=rule)(v, azimuth=azimuth),
        lambda v: Silhouette(rule=rule)(v, azimuth=azimuth, elevation=elevation, **photograph),
    )
    times = [[step(look, x)[0] for look in looks] for _ in range(REPEATS + 1)]
    level, tilted = (statistics.median(column) for column in zip(*times[1:]))
    return {"level_seconds": level, "tilted_seconds": tilted, "ratio": tilted / level}


def step(look: Callable[[Tensor], Tensor], x: Tensor) -> tuple[float, Tensor, Tensor]:
    x = x.detach().requires_grad_()
    start = time.process_time()
    y = look(x)
    (gradient,) = torch.autograd.grad(y.mean(), x)
    return time.process_time() - start, y.detach(), gradient


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
