"""Recipe: everything that decides what a run computes, as one frozen value."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypedDict

from torch import nn
from typing_extensions import Self

from .._types import UserError
from ..adversarial.augmentation import Augmentation
from ..adversarial.losses import Loss, Relativistic
from ..adversarial.matching import Matching
from ..adversarial.penalties import R1R2, Penalty
from ..adversarial.regularisers import Regulariser
from ..assignment import Panel
from ..domains import Domain
from ..networks import Discriminator, Generator
from .coarse import Coarse
from .tries import Tries


@dataclass(frozen=True)
class Adam:
    """Adam(β1, β2); the learning rate falls from `rate` to `final` along a cosine (default: it stays).

    Examples:
        >>> import unproject as up
        >>> up.Adam(1e-3, final=0.0).rate_at(progress=0.5)
        0.0005
    """

    rate: float = 1e-3
    beta1: float = 0.0
    beta2: float = 0.95
    final: float | None = None

    def __post_init__(self) -> None:
        betas = 0 <= self.beta1 < 1 and 0 <= self.beta2 < 1
        if not (0 <= self.rate < math.inf and betas and 0 <= (self.final or 0) < math.inf):
            raise UserError(f"{self}: give finite rates of at least 0, and betas of 0 to below 1")

    def rate_at(self, progress: float) -> float:
        """Return the learning rate when `progress`, 0 to 1, of the budget is spent."""
        if self.final is None:
            return self.rate
        return self.final + (self.rate - self.final) * (1 + math.cos(math.pi * min(progress, 1.0))) / 2


@dataclass(frozen=True)
class Origin:
    """How a recipe was made: a recipe function and the arguments that it was called with.

    Attributes:
        recipe: the name of a built-in recipe, `module:function` or `path/to/file.py:function`.
        function: `module:function`, or the same path, to find it by.
        arguments: JSON values.
    """

    recipe: str
    function: str
    arguments: dict[str, Any]


class Options(TypedDict, total=False):
    """Fields of `Recipe` that every recipe function takes as further keywords, and `unproject train` as flags.

    Examples:
        >>> import unproject as up
        >>> sorted(up.Options.__annotations__)[:3]
        ['balance_every', 'batch', 'checkpoint_every']
    """

    steps: int | None
    minutes: float | None
    batch: int
    views_per_sample: int
    discriminator_steps: int
    balance_every: int
    ema_half_life: float
    precision: Literal["float32", "bfloat16"]
    compile: bool
    checkpoint_every: int
    normalise_over: Literal["processes"] | None


@dataclass(frozen=True)
class Recipe:
    """What is learned (`generator`), from which projections (`panels`), and how.

    Args:
        generator: builds the generator; `functools.partial(LowRankGenerator, size=32)`.
        panels: observations and their data, a discriminator each. The `Identity` projection is direct training.
        domain: what the generator makes (default: the domain that the generator's class names).
        discriminator: (shape of one image, number of heads) → discriminator, which is called with images y (B, ...)
            and the head of each, (B,) integers, and returns logits (B,). An attribute `group` that is None is set to
            the batch: how many images its statistics are of.
        loss: the adversarial loss.
        penalty: the gradient penalty of the discriminators (None: no penalty).
        augmentation: of all images that discriminators see, real and generated; for small collections.
        matching: a loss that matches statistics of generated and real images, in every panel of images (default: none).
        generator_optimiser: Adam's settings for the generator.
        discriminator_optimiser: Adam's settings for the discriminators.
        regulariser: (x, progress) → a term of the generator's loss, such as `Solid()`; several as `Regularisers`.
        discriminator_steps: discriminator updates a generator update.
        batch: images an update, of each process.
        views_per_sample: projections of each generated sample in an update, which takes batch / views_per_sample
            samples.
        balance_every: steps between two measurements of the norm of the gradient of each panel's loss by the generator;
            each loss is divided by its norm, so that panels contribute as their weights say (0: losses as they are).
        ema_half_life: half-life of the exponential moving average of the generator's weights, in steps (0: none).
        steps: budget in steps. The run ends when either budget is spent.
        minutes: budget in minutes of the clock.
        seed: of the weights and of every draw.
        precision: bfloat16 runs the networks under autocast.
        compile: compile the generator with torch.compile.
        checkpoint_every: steps between checkpoints (and sample pictures).
        normalise_over: processes takes statistics of batch normalisation over the batches of all processes, so that
            equal batches of all have equal results (default: over each process's own batch, which is faster).
        tries: several short starts, of which the best goes on (default: one start).
        coarse: a recipe of half the size that is trained first (default: none).

    Raises:
        UserError: for no panel, no budget, or a number out of range.

    Examples:
        >>> import functools, unproject as up
        >>> itself = up.Observation("itself", up.Identity())
        >>> panel = up.Panel([itself], up.Collection(up.data.chairs(4, 16)))
        >>> recipe = up.Recipe(functools.partial(up.networks.LowRankGenerator, size=16), [panel], steps=10)
        >>> recipe.replace(batch=8).progress(step=5, seconds=0.0)
        0.5
    """

    generator: Callable[[], Generator]
    panels: Sequence[Panel]
    domain: Domain | None = None
    discriminator: Callable[[tuple[int, ...], int], nn.Module] = Discriminator
    loss: Loss = field(default_factory=Relativistic)
    penalty: Penalty | None = field(default_factory=R1R2)
    augmentation: Augmentation | None = None
    matching: Matching | None = field(default=None, metadata={"described": "if given"})
    generator_optimiser: Adam = field(default_factory=Adam)
    discriminator_optimiser: Adam = field(default_factory=Adam)
    regulariser: Regulariser | None = None
    discriminator_steps: int = 1
    batch: int = 64
    views_per_sample: int = 1
    balance_every: int = 0
    ema_half_life: float = 300.0
    steps: int | None = None
    minutes: float | None = None
    seed: int = 0
    precision: Literal["float32", "bfloat16"] = "float32"
    compile: bool = False
    checkpoint_every: int = 500
    normalise_over: Literal["processes"] | None = field(default=None, metadata={"described": "if given"})
    tries: Tries | None = field(default=None, metadata={"described": "if given"})
    coarse: Coarse | None = field(default=None, metadata={"described": "if given"})
    origin: Origin | None = field(default=None, compare=False, repr=False, metadata={"described": False})

    def __post_init__(self) -> None:
        if isinstance(self.panels, Panel):
            raise UserError("panels: give a list of panels, [panel] if there is one")
        object.__setattr__(self, "panels", tuple(self.panels))
        self._check_parts()
        self._check_numbers()
        self._check_budget()

    def _check_parts(self) -> None:
        """Raise UserError for parts that are none, or do not go together."""
        for name in ("generator", "discriminator"):
            if isinstance(getattr(self, name), nn.Module):
                raise UserError(f"{name}: is built for each run anew; give the class, or functools.partial of it")
        if not isinstance(self.loss, Loss):
            raise UserError(f"loss={self.loss!r}: give a Loss, such as up.Hinge()")
        if not isinstance(self.domain, Domain | None):
            raise UserError(f"domain={self.domain!r}: give a Domain, such as up.Images()")
        if not self.panels:
            raise UserError("the recipe has no panels: give at least one Panel(observations, data)")
        adaptive = self.augmentation is not None and self.augmentation.adaptive
        if adaptive and any(panel.held_out is None for panel in self.panels):
            raise UserError(
                "the augmentation follows the overfitting, which is measured on held-out images: give each panel some, "
                "Panel(..., held_out=...); Collection.split makes them"
            )
        if self.matching is not None and not self.balance_every:
            raise UserError(
                "matching: has its weight where the gradient of the adversarial loss has 1, which balance_every=0 does "
                "not measure; give balance_every=16, a measurement every 16 steps"
            )
        for name, choices in (("precision", ("float32", "bfloat16")), ("normalise_over", (None, "processes"))):
            if getattr(self, name) not in choices:
                raise UserError(f"{name}={getattr(self, name)!r}: choose from {', '.join(map(str, choices))}")

    def _check_numbers(self) -> None:
        """Raise UserError for numbers that cannot be."""
        for name in ("batch", "views_per_sample", "discriminator_steps", "checkpoint_every"):
            if getattr(self, name) < 1:
                raise UserError(f"{name}={getattr(self, name)}: must be at least 1")
        if self.balance_every < 0:
            raise UserError(f"balance_every={self.balance_every}: give steps between two measurements, or 0 for none")
        if not 0 <= self.ema_half_life < math.inf:
            raise UserError(f"ema_half_life={self.ema_half_life}: give steps, or 0 for no average")
        if self.batch % self.views_per_sample:
            raise UserError(f"batch={self.batch}: must be a multiple of views_per_sample={self.views_per_sample}")
        least = max(panel.assignment.least_batch for panel in self.panels)
        if self.batch < least:
            raise UserError(f"batch={self.batch}: the assignment of its panels needs at least {least}")

    def _check_budget(self) -> None:
        """Raise UserError unless there is a budget, of numbers that can be."""
        for name in ("steps", "minutes"):
            value = getattr(self, name)
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise UserError(f"{name}={value}: must be positive")
        if self.steps is None and self.minutes is None:
            raise UserError("the recipe has no budget: give steps or minutes")

    def __repr__(self) -> str:
        generator = getattr(self.generator, "func", self.generator)
        panels = ", ".join(f"{panel.observations[0].name} ({len(panel)})" for panel in self.panels)
        budget = f"steps={self.steps}, minutes={self.minutes}, batch={self.batch}, seed={self.seed}"
        return f"Recipe({getattr(generator, '__name__', generator)}, panels: {panels}, {budget})"

    @property
    def samples(self) -> int:
        """Samples that are generated for an update."""
        return self.batch // self.views_per_sample

    def progress(self, step: int, seconds: float) -> float:
        """Return the part of the budget that is spent, 0 to 1, what a coarse recipe took left out."""
        spent = part_spent(self.steps, self.minutes, step, seconds)
        return spent if self.coarse is None else self.coarse.fine(spent)

    def steps_until(self, progress: float, step: int, seconds: float) -> int:
        """Return how many steps are left, at `step`, to this part of the budget: with minutes, by the steps so far."""
        spent = progress if self.coarse is None else self.coarse.spent(progress)
        left = [spent * self.steps - step] if self.steps else []
        if self.minutes and seconds:
            left.append((60 * self.minutes * spent - seconds) * step / seconds)
        return max(math.ceil(min(left, default=0.0)), 1)

    def coarse_recipe(self) -> Recipe | None:
        """Return the recipe that is trained first, with its part of the budget; None if there is none.

        Raises:
            UserError: if `coarse.make` makes something else.
        """
        budget = None if self.coarse is None else self.coarse.budget(self.steps, self.minutes)
        if self.coarse is None or budget is None:
            return None
        made = self.coarse.make(**budget)
        if not isinstance(made, Recipe):
            raise UserError(f"coarse: made a {type(made).__name__}; make a Recipe of these steps and minutes")
        return made

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed."""
        if "origin" not in changes:
            changes["origin"] = self._origin_after(changes)
        return dataclasses.replace(self, **changes)

    def _origin_after(self, changes: dict[str, Any]) -> Origin | None:
        """Return how the changed recipe could be made: only options can be given to a recipe function again."""
        if self.origin is None or not changes.keys() <= Options.__annotations__.keys():
            return None
        budget = {"steps": self.steps, "minutes": self.minutes} if {"steps", "minutes"} & changes.keys() else {}
        return dataclasses.replace(self.origin, arguments={**self.origin.arguments, **budget, **changes})

    def configured(self, options: Options) -> Self:
        """Return a copy with these options; a budget that is given takes the place of the recipe's own."""
        given = {name: value for name, value in options.items() if name not in ("steps", "minutes")}
        budget = {name: options.get(name) for name in ("steps", "minutes")}
        return self.replace(**given, **(budget if any(v is not None for v in budget.values()) else {}))


def part_spent(steps: float | None, minutes: float | None, step: int, seconds: float) -> float:
    """Return the part of a budget that is spent: the larger of that of its steps and of its minutes."""
    return max(step / steps if steps else 0.0, seconds / (60 * minutes) if minutes else 0.0)
