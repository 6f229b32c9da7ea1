"""Where a training step of materials spends its time, and how much of it is rendering, forward and backward.

    python benchmarks/material_step.py --steps 40 --threads 1

Of four maps and renderings: those of the paper (natural light, top and grazing), flash, coloured lamps and ambient
light, and all kinds that recipes have by default.
Rendering is timed where it happens: the projection's call and, through hooks on its result and its argument, the way
back. Medians over steps, of the clock on the wall.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import torch
from torch import Tensor

import unproject as up
from unproject.data.readers.lights import FIRST
from unproject.ops.maps import MAPS
from unproject.projections.rendering import Rendering
from unproject.recipes.materials import wood_materials
from unproject.training.trainer import Trainer

PARTS = {"_generate": "generator", "_batch": "projection", "_update_discriminators": "discriminators' update"}
WARM = 3  # steps before the first that counts


class Clock:
    """Seconds by part, of one step at a time."""

    def __init__(self) -> None:
        self.steps: dict[str, list[float]] = defaultdict(list)
        self.now: dict[str, float] = defaultdict(float)

    def close(self, seconds: float) -> None:
        for part, spent in {**self.now, "step": seconds}.items():
            self.steps[part].append(spent)
        self.now.clear()

    def timed(self, function: Callable[..., Any], part: str) -> Callable[..., Any]:
        def run(*args: Any, **flags: Any) -> Any:
            began = time.perf_counter()
            result = function(*args, **flags)
            self.now[part] += time.perf_counter() - began
            return result

        return run


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--size", type=int, default=64)
    options = parser.parse_args(argv)
    torch.set_num_threads(options.threads)
    print("| renderings | step | generator | projection | discriminators' update | rendering, both ways | its share |")
    print("|---" * 7 + "|")
    for renderings in (("top", "grazing"), ("flash", "coloured", "ambient"), FIRST):
        found = {name: median(values[WARM:]) for name, values in profile(renderings, options).items()}
        cells = [f"{found[name]:.3f} s" for name in ("step", *PARTS.values(), "rendering")]
        print(f"| {', '.join(renderings)} | " + " | ".join(cells) + f" | {found['rendering'] / found['step']:.0%} |")


def profile(renderings: tuple[str, ...], options: argparse.Namespace) -> dict[str, list[float]]:
    clock = Clock()
    forward, advance = Rendering.forward, Trainer.step

    def step(trainer: Trainer) -> None:
        began = time.perf_counter()
        advance(trainer)
        clock.close(time.perf_counter() - began)

    def render(self: Rendering, maps: Tensor, **latents: Tensor) -> Tensor:
        began = time.perf_counter()
        there = maps * 1 if maps.requires_grad else maps  # a place of its own to end the way back
        seen = forward(self, there, **latents)
        clock.now["rendering"] += time.perf_counter() - began
        return _timed_back(clock, there, seen)

    recipe = wood_materials(
        observations=(*MAPS, *renderings), maps=64, renderings=64, size=options.size, steps=options.steps
    )
    with ExitStack() as stack:
        stack.enter_context(patch.object(Trainer, "step", step))
        stack.enter_context(patch.object(Rendering, "forward", render))
        for name, part in PARTS.items():
            stack.enter_context(patch.object(Trainer, name, clock.timed(getattr(Trainer, name), part)))
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        up.train(recipe, out=Path(folder) / "run", quiet=True)
    return clock.steps


def _timed_back(clock: Clock, there: Tensor, seen: Tensor) -> Tensor:
    """`seen`, with the time from its gradient to that of `there` counted as rendering."""
    if not seen.requires_grad:
        return seen
    began = [0.0]

    def start(_: Tensor) -> None:
        began[0] = time.perf_counter()

    def stop(_: Tensor) -> None:
        clock.now["rendering"] += time.perf_counter() - began[0]

    seen.register_hook(start)
    there.register_hook(stop)
    return seen


if __name__ == "__main__":
    main()
