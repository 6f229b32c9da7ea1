"""What a step of each recipe and each operator costs on a GPU.

    python benchmarks/gpu.py                       # all
    python benchmarks/gpu.py --only shapes wood    # steps of these recipes
    python benchmarks/gpu.py --only operators

Of each recipe, with default flags and procedural data: milliseconds of a step (median of blocks of steps, the clock
read when the GPU is done), in which how many kernels are started and how long they run together (torch.profiler). Where
they run for less than the step takes, the processor that starts them is what limits. Arms: float32 with convolutions in
TF32, as torch has it; the same without replaying passes (`training.graphs`); bfloat16; and the generator compiled.

Operators, forward + backward, by CUDA events: silhouettes at 64³ of 16 shapes, against the released algorithm; line
integrals at 32² of 128 images, against turning by grid_sample; renderings at 64² of 8 materials, 32 samples.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lines
import rendering
import silhouettes
import torch
from results import origin
from torch import Tensor
from torch.profiler import ProfilerActivity, profile

from unproject._random import generator_at
from unproject.ops.lights import Environment
from unproject.ops.shading import Sampling
from unproject.ops.shading_native import shade_fast
from unproject.projections.line_integral import LineIntegral
from unproject.projections.silhouette import RULES, Silhouette
from unproject.recipes import find
from unproject.training import graphs
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

DEVICE = "cuda"
WARM, BLOCK, BLOCKS, PROFILED = 24, 16, 5, 16
RECIPES: dict[str, tuple[str, dict[str, Any]]] = {
    "shapes": ("shapes", {"size": 32}),
    "shapes-64": ("shapes", {"size": 64}),
    "shapes-known": ("shapes", {"size": 32, "views": "known"}),
    "shapes-paper": ("shapes-paper", {"size": 64, "views": "known"}),
    "digits": ("digits", {}),
    "wood": ("wood", {}),
}
ARMS: dict[str, dict[str, Any]] = {
    "float32": {"precision": "float32"},
    "not replayed": {"precision": "float32"},
    "bfloat16": {"precision": "bfloat16"},
    "compiled": {"precision": "float32", "compile": True},
}


def seconds_of(steps: Callable[[], object]) -> float:
    torch.cuda.synchronize()
    began = time.perf_counter()
    steps()
    torch.cuda.synchronize()
    return time.perf_counter() - began


def step_costs(recipe: str, flags: dict[str, Any]) -> dict[str, float]:
    """Return milliseconds of a step, of its kernels together, how many these are, and MiB at most."""
    with tempfile.TemporaryDirectory() as name, Recorder(Path(name), quiet=True) as recorder:
        made = find(recipe)(**flags).replace(checkpoint_every=10**9, steps=10**6, tries=None)
        trainer = Trainer(made, Path(name), recorder, distribution=Distribution(DEVICE))
        torch.cuda.reset_peak_memory_stats()

        def steps(count: int) -> Callable[[], object]:
            return lambda: [trainer.step() for _ in range(count)]

        first = seconds_of(steps(WARM))
        taken = statistics.median(seconds_of(steps(BLOCK)) for _ in range(BLOCKS)) / BLOCK
        with profile(activities=[ProfilerActivity.CUDA]) as watched:
            seconds_of(steps(PROFILED))
        kernels = [event for event in watched.events() if event.device_type == torch.autograd.DeviceType.CUDA]
        busy = sum(event.device_time_total for event in kernels)
    return {
        "ms": round(1e3 * taken, 2),
        "kernels": round(len(kernels) / PROFILED),
        "kernel_ms": round(busy / 1e3 / PROFILED, 2),
        "first_steps_s": round(first, 1),
        "MiB": round(torch.cuda.max_memory_allocated() / 2**20),
    }


def milliseconds(look: Callable[[Tensor], Tensor], x: Tensor, repeats: int = 30) -> float:
    """Return the median of forward and backward by events."""
    x = x.detach().requires_grad_()
    found = []
    for repeat in range(repeats + 3):
        start, end = torch.cuda.Event(enable_timing=True), torch.cuda.Event(enable_timing=True)
        start.record()
        torch.autograd.grad(look(x).mean(), x)
        end.record()
        torch.cuda.synchronize()
        if repeat >= 3:
            found.append(start.elapsed_time(end))
    return round(statistics.median(found), 3)


def operators() -> dict[str, dict[str, float]]:
    """Operator → implementation → milliseconds."""
    torch.set_default_device(DEVICE)  # of the coordinates that references make
    try:
        return _silhouettes() | {"line integrals": _lines(), "rendering": _rendering()}
    finally:
        torch.set_default_device("cpu")


def _silhouettes() -> dict[str, dict[str, float]]:
    side, batch = silhouettes.SIZE, silhouettes.BATCH
    x = (torch.rand(batch, side, side, side, generator=generator_at(0), device="cpu") ** 8).to(DEVICE)
    azimuth = (torch.rand(batch, generator=generator_at(1), device="cpu") * 6.28).to(DEVICE)

    def of(rule: str) -> dict[str, float]:
        ours = Silhouette(rule=rule)  # pyright: ignore[reportArgumentType]
        return {
            "released": milliseconds(lambda v: silhouettes.released(v, azimuth, rule), x),
            "ours": milliseconds(lambda v: ours(v, azimuth=azimuth), x),
            "tilted": milliseconds(lambda v: ours(v, azimuth=azimuth, elevation=azimuth / 10), x),
        }

    return {f"silhouettes, {rule}": of(rule) for rule in RULES}


def _lines() -> dict[str, float]:
    x = torch.rand(lines.BATCH, 1, lines.SIZE, lines.SIZE)
    angle = torch.rand(lines.BATCH) * 6.28
    return {
        "turned": milliseconds(lambda v: lines.turned(v, angle), x),
        "plain": milliseconds(lambda v: LineIntegral(fast=False)(v, angle=angle), x),
        "ours": milliseconds(lambda v: LineIntegral()(v, angle=angle), x),
    }


def _rendering() -> dict[str, float]:
    torch.set_default_device("cpu")
    x, (camera, light) = rendering.materials().to(DEVICE), rendering.scene()
    placed = Environment(type(light.environments)(*(part.to(DEVICE) for part in light.environments)), *(
        part.to(DEVICE) for part in light[1:]))  # fmt: skip
    jitter = torch.full((len(x),), 0.3, device=DEVICE)
    options = Sampling(rendering.SAMPLES, 0.5)
    given = camera.to(DEVICE), placed, rendering.MODEL, options, jitter
    return {
        "plain": milliseconds(lambda v: rendering.plain(v, *given), x, 5),
        "ours": milliseconds(lambda v: shade_fast(v, *given), x, 5),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[*RECIPES, "operators"], choices=[*RECIPES, "operators"])
    parser.add_argument("--arms", nargs="*", default=list(ARMS), choices=list(ARMS))
    options = parser.parse_args()
    print(json.dumps({**origin(), "gpu": torch.cuda.get_device_name()}), flush=True)
    if "operators" in options.only:
        for name, row in operators().items():
            print(json.dumps({"operator": name, **row}), flush=True)
    for name in options.only:
        for arm in options.arms if name in RECIPES else ():
            recipe, flags = RECIPES[name]
            graphs.ENABLED = arm != "not replayed"
            row = step_costs(recipe, {**flags, **ARMS[arm]})
            print(json.dumps({"recipe": name, "arm": arm, **row}), flush=True)


if __name__ == "__main__":
    main()
