"""Line integrals at 32², batch 128, forward + backward: strips against turning images by `grid_sample` and summing.

They take turns in one run on one thread, timed in CPU seconds; the figure is the ratio of the medians. They do not
measure quite the same: turning blurs, strips are exact. The differences say by how much. Beside them, if it is there
(`make bench` installs it), the operator of deepinv's Tomography: all its images share their angles, here one, it looks
at the corners too, and its grids are made beforehand. Only its one file is loaded: the package asks for torchvision.
"""

from __future__ import annotations

import importlib.util
import json
import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from unproject._random import generator_at
from unproject.projections.line_integral import LineIntegral

SIZE, BATCH, REPEATS = 32, 128, 50


def turned(x: Tensor, angle: Tensor) -> Tensor:
    """(B, 1, N, N) → (B, 1, N): the image turned by -angle, and the mean of its columns."""
    c, s, zero = angle.cos(), angle.sin(), torch.zeros_like(angle)
    matrix = torch.stack([torch.stack([c, s, zero], 1), torch.stack([-s, c, zero], 1)], 1)
    return F.grid_sample(x, F.affine_grid(matrix, list(x.shape), align_corners=False), align_corners=False).mean(2)


def run() -> dict[str, float]:
    x = torch.rand(BATCH, 1, SIZE, SIZE, generator=generator_at(0))
    x = F.avg_pool2d(F.pad(x, (2, 2, 2, 2)), 5, 1)  # smooth, as pictures are
    place = (torch.arange(SIZE) * 2 + 1 - SIZE) / SIZE
    x = x * (place.square() + place[:, None].square() < 0.8)  # turning loses what is in the corners
    angle = torch.rand(BATCH, generator=generator_at(1)) * 2 * math.pi
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    looks = {
        "turned": lambda v: turned(v, angle),
        "plain": lambda v: LineIntegral(fast=False)(v, angle=angle),
        "fast": lambda v: LineIntegral()(v, angle=angle),
    }
    radon = deepinv_radon(30.0)
    if radon is not None:
        looks["deepinv"] = radon
    try:
        seen = {name: look(x) for name, look in looks.items()}
        times: dict[str, list[float]] = {name: [] for name in looks}
        for repeat in range(REPEATS):
            for name, look in looks.items():
                if name != "plain" or repeat < 5:
                    times[name].append(step(look, x))
    finally:
        torch.set_num_threads(threads)
    seconds = {name: statistics.median(column) for name, column in times.items()}
    beside = {"ratio_to_deepinv": seconds["deepinv"] / seconds["fast"]} if radon is not None else {}
    return {
        **beside,
        **{f"{name}_seconds": value for name, value in seconds.items()},
        "ratio": seconds["turned"] / seconds["fast"],
        "difference_plain": (seen["fast"] - seen["plain"]).abs().max().item(),
        "difference_turned": (seen["fast"] - seen["turned"]).abs().max().item(),
    }


def deepinv_radon(degrees: float) -> Callable[[Tensor], Tensor] | None:
    """What deepinv.physics.Tomography applies, for one angle; None if deepinv is not installed."""
    found = importlib.util.find_spec("deepinv")
    if found is None or found.origin is None:
        return None
    file = Path(found.origin).parent / "physics" / "functional" / "radon.py"
    spec = importlib.util.spec_from_file_location("deepinv_radon", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Radon(SIZE, torch.tensor([degrees]))


def step(look: Callable[[Tensor], Tensor], x: Tensor) -> float:
    x = x.detach().requires_grad_()
    start = time.process_time()
    torch.autograd.grad(look(x).mean(), x)
    return time.process_time() - start


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
