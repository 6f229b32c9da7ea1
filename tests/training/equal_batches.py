"""Train toys in one process by batches of 8, and in two by batches of 4 each: `python equal_batches.py FOLDER`.

`tests/test_processes.py` compares what they write into FOLDER/whole and FOLDER/halves. The mutant, in FOLDER/mutant,
draws in each process alone, as from a source of its own.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import torch
from pair import in_two
from toy import only_panel, toy, with_panel

from unproject._random import generator_at
from unproject.adversarial.adaptive import Adaptive
from unproject.adversarial.augmentation import Affine, Sometimes
from unproject.adversarial.matching import Matching
from unproject.adversarial.penalties import GradientPenalty
from unproject.assignment import LearnedLatent
from unproject.training import Recipe, train, trainer
from unproject.training.distribution import Distribution


def elevation(recipe: Recipe) -> Recipe:
    """Cameras whose elevation is learned."""
    views = only_panel(recipe).observations
    return with_panel(recipe, observations=views, learned=(LearnedLatent("elevation", 0.2, 0.1, 0.0, 1.0),))


def held_out(recipe: Recipe) -> Recipe:
    """Images held out, and an augmentation that follows the overfitting."""
    train_on, kept = only_panel(recipe).collections[0].split(0.3)
    return with_panel(recipe, data=train_on, held_out=kept).replace(
        augmentation=Adaptive(Affine(), every=2, start=0.5), views_per_sample=2
    )


def recipes(batch: int) -> dict[str, Recipe]:
    # Adam makes full steps of gradients that are zero but for rounding, as a bias has for losses of differences.
    plain = {"steps": 5, "batch": batch, "loss": "hinge"}
    return {
        "known": toy(**plain, views="known", discriminator_steps=2).replace(penalty=GradientPenalty(10.0)),
        "single": toy(**plain, views="single").replace(augmentation=Sometimes(Affine(), 0.3)),
        "predicted": toy(**plain, draw="posterior", starts=(0.35,)),
        "elevation": elevation(toy(**plain, views="single")),
        "matched": toy(**plain, views="known").replace(matching=Matching(), balance_every=16),
        "held-out": held_out(toy(**plain, views="single")),
    }


def alone(self: Distribution, seed: int, step: int, stream: str, rows: object = None) -> torch.Generator:
    return generator_at(seed, step, f"{stream}/{self.rank}")


def train_each(folder: Path, chosen: dict[str, Recipe]) -> None:
    for name, recipe in chosen.items():
        train(replace(recipe, origin=None, normalise_over="processes"), folder / name, device="cpu", quiet=True)


def in_each(folder: Path) -> None:
    """What each of the two does."""
    train_each(folder / "halves", recipes(4))
    Distribution.part = alone  # type: ignore[method-assign]
    train_each(folder / "mutant", {"known": recipes(4)["known"]})  # one is enough to tell


def main(folder: Path) -> None:
    torch.set_num_threads(1)
    trainer.EVERY = 1
    train_each(folder / "whole", recipes(8))
    in_two(lambda: in_each(folder))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
