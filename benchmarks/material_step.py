"""Where a training step of materials spends its time, and how much of it is rendering, forward and backward.

    python benchmarks/material_step.py --steps 40 --threads 1

Of four maps and renderings: those of the paper (natural light, top and grazing), flash, coloured lamps and ambient
light, and all kinds that recipes have by default.
Rendering is timed where it happens: the projection's call and, through hooks on its result and its argument, the way
back. Medians over steps, of the clock on the wall.

What the statistics of the second order cost is the difference to a recipe without them: both are trained side by side,
a step each in turn, in seconds of the processor, summed over 48 steps (the period of all that is not done in every
step: penalties in each 4th, the statistics in each 3rd, norms of gradients in each 16th). Median over such turns, and
that of every other one, which says how noisy the machine is.
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
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

PARTS = {"_generate": "generator", "_batch": "projection", "_update_discriminators": "discriminators' update"}
WARM = 3  # steps before the first that counts
TURN, NEVER = 48, 10**9


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
    parser.add_argument("--turns", type=int, default=4, help="of 48 steps with and without the statistics")
    options = parser.parse_args(argv)
    torch.set_num_threads(options.threads)
    print("| renderings | step | generator | projection | discriminators' update | rendering, both ways | its share |")
    print("|---" * 7 + "|")
    for renderings in (("top", "grazing"), ("flash", "coloured", "ambient"), FIRST):
        found = {name: median(values[WARM:]) for name, values in profile(renderings, options).items()}
        cells = [f"{found[name]:.3f} s" for name in ("step", *PARTS.values(), "rendering")]
        print(f"| {', '.join(renderings)} | " + " | ".join(cells) + f" | {found['rendering'] / found['step']:.0%} |")
    shares = statistics_share(options)
    halves = ", ".join(f"{median(shares[k::2]):.1%}" for k in range(2)) if len(shares) > 1 else ""
    print(f"statistics of the second order: {median(shares):.1%} of a step ({halves})")


def statistics_share(options: argparse.Namespace) -> list[float]:
    """Return the share of a step's time that the statistics take, of each turn."""
    with tempfile.TemporaryDirectory() as folder, Recorder(Path(folder), quiet=True) as recorder:
        trainers = []
        for weight in (2.0, 0.0):
            recipe = wood_materials(maps=64, renderings=64, size=options.size, matching=weight, steps=NEVER)
            recipe = recipe.replace(checkpoint_every=NEVER)
            trainers.append(Trainer(recipe, Path(folder), recorder, distribution=Distribution("cpu")))
        found = []
        for _ in range(1 + options.turns):
            steps = [[_seconds(trainer) for trainer in trainers] for _ in range(TURN)]
            with_them, without = map(sum, zip(*steps, strict=True))
            found.append(1 - without / with_them)
    return found[1:]  # in the first turn all is begun


def _seconds(trainer: Trainer) -> float:
    """Return the processor's seconds of a step."""
    began = time.process_time()
    trainer.step()
    return time.process_time() - began


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
