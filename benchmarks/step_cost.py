"""What the parts of a training step of `shapes` cost, and silhouettes, as shares and ratios measured in one run.

    python benchmarks/step_cost.py                            # 32³ and 64³, and silhouettes: about 20 minutes
    python benchmarks/step_cost.py --sizes 32 --no-silhouettes          # three, or six on a busy machine

Default flags, one thread, silhouettes of embedded procedural chairs. Arms, each with networks, optimisers and pictures
of its own, all begun with the weights of one short training, and views given evenly, so that all heads are in use:

    as it is       the default: JointlyPredicted, Adaptive(Affine), Connected; augmentation at its greatest strength
    strength 0     the default while no overfitting is measured: augmentation draws, and changes nothing
    steering       with `--information 0.3`, in the first fifth of a budget: the predictor steers the generator too
    information    without it: the plain Predicted assignment of the same rounds, which has no predictor within a step
    augmentation   without it: no picture held out, none augmented
    both           without the two
    Connected      without it
    float32        the default in single precision, where it is in bfloat16: how many times the time that takes

The arms alternate step by step, in CPU seconds, so that other work on the machine slows all alike. A turn is eight
steps of each, the period of the gradient penalty. With t and t' the seconds of steps as it is and without, and of each
of the eight the median over turns, share = mean median(t - t') / mean median(t); those of the two halves of the turns,
every other one, say how noisy the machine is. Asked: information and augmentation at most 10 % of a step. A round, in
which all pictures are assigned anew, is timed apart: a run has 40 of them, and only those of the plain Predicted fit a
predictor, which the last line sets against a run of 20 minutes.

Silhouettes at 64³, batch 16, both ways: level ones against the released algorithm (asked: 15 times as fast), tilted
ones against level ones (asked: at most 3 times the time), `silhouettes.py` says how.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import silhouettes
import torch
from results import origin

from unproject.assignment import JointlyPredicted, Predicted
from unproject.data import chairs, observe
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.recipes.shapes import shapes
from unproject.training import Recipe
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer
from unproject.training.training_context import TrainingContext

CHAIRS, EACH, PERIOD, NEVER = 100, 16, 8, 10**9
"""Shapes, silhouettes of each, steps of a turn, and a budget of which these steps spend nothing."""
STRENGTH, DUE = 0.8, 0.02
"""The most that `Adaptive` rises to, and a part of the budget at which a round is due."""
ROUNDS, MINUTES, WHOLE, SINGLE = 40, 20, "as it is", "float32"
ASKED, TIMES, TILTED = 0.1, 15.0, 3.0


def plain_views(recipe: Recipe) -> Recipe:
    """Return the recipe with views predicted in rounds alone."""
    (panel,) = recipe.panels
    joint = panel.assignment
    assert isinstance(joint, JointlyPredicted)
    plain = Predicted(joint.rounds, joint.fit, joint.estimator)
    return recipe.replace(panels=[replace(panel, assignment=plain)])


@dataclass(frozen=True)
class Arm:
    """A name, the flags and the change that make its recipe, and the strength of its augmentation."""

    name: str
    flags: dict[str, Any]
    change: Callable[[Recipe], Recipe] = lambda recipe: recipe
    strength: float = STRENGTH


ARMS = (
    Arm(WHOLE, {}),
    Arm("strength 0", {}, strength=0.0),
    Arm("steering", {"information": 0.3}),
    Arm("information", {"tries": 1}, plain_views),
    Arm("augmentation", {"augment": False}),
    Arm("both", {"augment": False, "tries": 1}, plain_views),
    Arm("Connected", {"connected": 0.0}),
    Arm(SINGLE, {"precision": "float32"}),
)


class Timed:
    """A training of one arm, of which single blocks of steps and single rounds are timed."""

    def __init__(self, arm: Arm, data: Path, size: int, folder: Path, recorder: Recorder) -> None:
        recipe = arm.change(shapes(data=data, size=size, **arm.flags))
        recipe = recipe.replace(steps=NEVER, checkpoint_every=NEVER)
        self.trainer = Trainer(recipe, folder, recorder, distribution=Distribution("cpu"))
        self.arm, (self.panel,) = arm, self.trainer.state.panels

    def begin(self, other: Timed) -> None:
        """Take over the networks of a training; give views evenly, as the time of heads depends on that."""
        state, begun = self.trainer.state, other.trainer.state
        state.counters.step = 0  # all at the same place in the period of the penalty
        for name in ("generator", "average", "discriminators"):
            getattr(state, name).load_state_dict(getattr(begun, name).state_dict())
        if self.panel.augmentation is not None:
            self.panel.augmentation.get_buffer("strength").fill_(self.arm.strength)
        for name in {"views", "heads", "held_out_heads"} & dict(self.panel.assignment.named_buffers()).keys():
            given = self.panel.assignment.get_buffer(name)
            given.copy_(torch.arange(len(given)) % len(self.panel.panel.observations))

    def step(self) -> float:
        """Return the CPU seconds of a step."""
        began = time.process_time()
        self.trainer.step()
        return time.process_time() - began

    def round(self) -> float:
        """Return the CPU seconds of a round, in which views are assigned anew."""
        self.panel.assignment.get_buffer("round").fill_(0)
        began = time.process_time()
        assert self.panel.assignment.before_step(TrainingContext(self.trainer, DUE, 0))
        return time.process_time() - began


def pictures(size: int, count: int, folder: Path) -> Path:
    """Write silhouettes of procedural chairs."""
    views = azimuth_bins(16, Silhouette(size=size, rule="absorption", density=2.0))
    path = folder / f"chairs-{size}.npz"
    np.savez(path, image=(255 * observe(chairs(count, size), views, EACH, seed=0).floats()).round().byte().numpy())
    return path


def turns(size: int, repeats: int, warm: int, count: int = CHAIRS) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return seconds (turns, steps) of each arm, and of a round with and without the information."""
    with tempfile.TemporaryDirectory() as name, Recorder(Path(name), quiet=True) as recorder:
        folder = Path(name)
        data = pictures(size, count, folder)
        arms = [Timed(arm, data, size, folder, recorder) for arm in ARMS]
        for _ in range(warm):
            arms[0].step()
        for arm in arms:
            arm.begin(arms[0])
        seconds = np.array([turn(arms) for _ in range(repeats + 1)][1:])  # first steps have work that others have not
        compared = [arm for arm in arms if arm.arm.name in (WHOLE, "information")]
        rounds = {arm.arm.name: median(arm.round() for _ in range(min(repeats, 3))) for arm in compared}
    return {arm.name: seconds[:, :, k] for k, arm in enumerate(ARMS)}, rounds


def turn(arms: Sequence[Timed]) -> list[list[float]]:
    """Return the seconds of the next steps (steps, arms), taken in turn."""
    return [[arm.step() for arm in arms] for _ in range(PERIOD)]


def typical(seconds: np.ndarray) -> float:
    """Return the mean over a turn's steps of the medians over turns."""
    return float(np.median(seconds, 0).mean())


def share(whole: np.ndarray, without: np.ndarray) -> float:
    """Return the share of a step that is spared, from seconds (turns, steps) in the same turns."""
    return typical(whole - without) / typical(whole)


def step_table(size: int, seconds: dict[str, np.ndarray], rounds: dict[str, float]) -> str:
    whole = seconds[WHOLE]
    lines = [f"| {size}³, without | seconds a step | share of a step | halves of the turns | asked |", "|---" * 5 + "|"]
    lines.append(f"| nothing | {typical(whole):.3f} | | | |")
    for name, column in seconds.items():
        if name in (WHOLE, SINGLE):
            continue
        found, halves = share(whole, column), [share(whole[k::2], column[k::2]) for k in range(2) if len(whole) > 1]
        asked = "" if name != "both" else f"at most {ASKED:.0%}: " + ("met" if found <= ASKED else "MISSED")
        spread = ", ".join(f"{half:.1%}" for half in halves)
        lines.append(f"| {name} | {typical(column):.3f} | {found:.1%} | {spread} | {asked} |")
    joint, plain = rounds[WHOLE], rounds["information"]
    spared = ROUNDS * (plain - joint) / (60 * MINUTES)
    told = f"A round of {CHAIRS * EACH} pictures: {joint:.2f} s, without information {plain:.2f} s; {ROUNDS} rounds"
    times = typical(seconds[SINGLE]) / typical(whole)
    single = f"In float32 a step takes {typical(seconds[SINGLE]):.3f} s, {times:.2f} times the time"
    return "\n".join([*lines, "", f"{told} spare {spared:.1%} of a run of {MINUTES} minutes", single])


def silhouette_table(found: dict[str, dict[str, float]]) -> str:
    lines = ["| silhouettes 64³ | against | ratio | asked |", "|---" * 4 + "|"]
    for name, values in found.items():
        if "level_seconds" in values:
            met = "met" if values["ratio"] <= TILTED else "MISSED"
            lines.append(f"| {name} | level | {values['ratio']:.2f} times the time | {TILTED:.0f}: {met} |")
        else:
            met = "met" if values["ratio"] >= TIMES else "MISSED"
            lines.append(f"| level, {name} | released | {values['ratio']:.1f} times as fast | {TIMES:.0f}: {met} |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="+", type=int, default=(32, 64))
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--warm", type=int, default=60, help="steps of the short training")
    parser.add_argument("--no-silhouettes", action="store_true")
    given = parser.parse_args(argv)
    torch.set_num_threads(1)
    print(" ".join(f"{name}: {value}" for name, value in origin().items()), flush=True)
    for size in given.sizes:
        print(step_table(size, *turns(size, given.repeats, given.warm)), "", sep="\n", flush=True)
    if not given.no_silhouettes:
        print(silhouette_table(silhouettes.run()))


if __name__ == "__main__":
    main()
