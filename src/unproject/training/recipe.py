"""Recipe: everything that decides what a run computes, as one frozen value."""

from __future__ import annotations

import hashlib
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn

from .._types import UserError
from ..adversarial.assignment import Known, Predicted
from ..adversarial.augmentation import Augmentation
from ..adversarial.learned_prior import LearnedPrior
from ..adversarial.losses import Loss, Relativistic
from ..adversarial.penalties import R1R2, Penalty
from ..data import Collection
from ..networks import Discriminator, Generator
from ..projections.observation import Observation

Looks = Sequence[tuple[Observation, Collection]]


@dataclass(frozen=True)
class Adam:
    """Adam(β1, β2); the learning rate goes from `rate` to `final` (if given) along a cosine over the budget."""

    rate: float = 1e-3
    beta1: float = 0.0
    beta2: float = 0.95
    final: float | None = None

    def rate_at(self, progress: float) -> float:
        if self.final is None:
            return self.rate
        return self.final + (self.rate - self.final) * (1 + math.cos(math.pi * min(progress, 1.0))) / 2


@dataclass(frozen=True)
class Recipe:
    """What is learned (`generator`), from what (`looks`), and how. Derive one from another with `replace`.

    Args:
        generator: builds the generator; `functools.partial(LowRankGenerator, size=32)`.
        looks: pairs of an observation and the collection of what it saw. With `Predicted` or `LearnedPrior`,
            every observation stands beside the same collection. The `Identity` projection is direct training.
        discriminator: (shape of one image, number of heads) → discriminator.
        augmentation: of all that discriminators see, real and generated; for small collections.
        regulariser: a term of the generator's loss, a function of x itself and of the part of the budget spent.
        discriminator_steps: discriminator updates a generator update.
        batch: images an update.
        looks_each: how often each generated thing is looked at in an update, which needs batch / looks_each things.
        balance: every so many steps, measure how hard each panel pulls at the generator (the norm of the gradient of
            its loss), and let its loss count divided by that, times its weight: else what varies least, and is
            magnified most, outvoices the rest. 0 takes losses as they are.
        half_life: of the averaged weights, in steps.
        steps, minutes: the budget; the run ends when either is spent. Give at least one.
        precision: "bfloat16" runs the networks under autocast.
        compile: run the networks through `torch.compile`.
        checkpoint_every: steps between checkpoints (and sample pictures).
    """

    generator: Callable[[], Generator]
    looks: Looks
    assignment: Known | Predicted | LearnedPrior = field(default_factory=Known)
    discriminator: Callable[[tuple[int, ...], int], nn.Module] = Discriminator
    loss: Loss = field(default_factory=Relativistic)
    penalty: Penalty | None = field(default_factory=R1R2)
    augmentation: Augmentation | None = None
    generator_optimiser: Adam = field(default_factory=Adam)
    discriminator_optimiser: Adam = field(default_factory=Adam)
    regulariser: Callable[[Tensor, float], Tensor] | None = None
    discriminator_steps: int = 1
    batch: int = 64
    looks_each: int = 1
    balance: int = 0
    half_life: float = 300.0
    steps: int | None = None
    minutes: float | None = None
    seed: int = 0
    precision: Literal["float32", "bfloat16"] = "float32"
    compile: bool = False
    checkpoint_every: int = 500

    def __post_init__(self) -> None:
        if not self.looks:
            raise UserError("the recipe has no looks: give at least one (observation, collection)")
        for name in ("batch", "looks_each", "discriminator_steps", "checkpoint_every"):
            if getattr(self, name) < 1:
                raise UserError(f"{name}={getattr(self, name)}: must be at least 1")
        if self.balance < 0:
            raise UserError(f"balance={self.balance}: give steps between two measurements, or 0 for none")
        if self.batch % self.looks_each:
            raise UserError(f"batch={self.batch}: must be a multiple of looks_each={self.looks_each}")
        for name in ("steps", "minutes"):
            value = getattr(self, name)
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise UserError(f"{name}={value}: must be positive")
        if self.steps is None and self.minutes is None:
            raise UserError("the recipe has no budget: give steps or minutes")

    def progress(self, step: int, seconds: float) -> float:
        """The part of the budget that is spent, 0 to 1."""
        by_step = step / self.steps if self.steps else 0.0
        by_time = seconds / (60 * self.minutes) if self.minutes else 0.0
        return max(by_step, by_time)

    replace = replace


def describe(value: Any) -> Any:
    """A JSON description of a recipe or of any part: what recipe.json holds, and what a resumed run must match."""
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Collection):
        # Not its source: the same data may be reached by another path.
        return {"collection": list(value.items.shape), "sha256": fingerprint(value.items)}
    if isinstance(value, Tensor):
        return {"tensor": list(value.shape), "sha256": fingerprint(value)}
    if isinstance(value, partial):
        return {
            "call": full_name(value.func),
            "arguments": describe(value.keywords),
            "positional": describe(value.args),
        }
    if is_dataclass(value) and not isinstance(value, type):
        return {"type": full_name(type(value)), **{f.name: describe(getattr(value, f.name)) for f in fields(value)}}
    if isinstance(value, Mapping):
        return {str(key): describe(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [describe(part) for part in value]
    if inspect.isroutine(value) or isinstance(value, type):
        return {"call": full_name(value), "arguments": {}, "positional": []}
    return {"type": full_name(type(value)), **describe(vars(value))}


def full_name(value: Any) -> str:
    """`module:qualified.name` of a function or class."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    return f"{module}:{name}" if module and name else f"{type(value).__module__}:{type(value).__qualname__}"


def fingerprint(tensor: Tensor) -> str:
    """The SHA-256 of a tensor's values, shortened to 16 digits."""
    data = tensor.detach().cpu().contiguous().reshape(-1)
    return hashlib.sha256(data.view(torch.uint8).numpy().tobytes()).hexdigest()[:16]
