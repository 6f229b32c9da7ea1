"""State: everything a step changes, and nothing else; what a checkpoint holds."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim import Adam as TorchAdam

from .._random import derived_seed, seeded
from .._types import UserError
from ..adversarial.augmentation import AugmentationState
from ..adversarial.matching import MatchingState
from ..assignment import AssignmentState, Panel
from ..assignment.context import Processes
from ..data.sampling import spread_rows
from ..domains import Domain, domain_of
from ..networks import Generator
from .counters import COUNTERS, Counters
from .optimisers import load_optimiser, optimiser_of, optimiser_tensors
from .recipe import Recipe
from .shared_statistics import share_statistics, shares_statistics

LEVEL = math.radians(6)
"""Cameras count as level if the mean and the spread of their elevation are less together."""
KEPT = "kept/"
"""Prefix of the tensors of the best try."""


@dataclass
class PanelState:
    """A panel in training: discriminator, assignment, augmentation, and its loss's gradient norm (see `balancing`).

    `gradient_norm` is 0 until it is measured.
    """

    panel: Panel
    discriminator: nn.Module
    assignment: AssignmentState
    augmentation: AugmentationState | None = None
    matching: MatchingState | None = None
    gradient_norm: float = 0.0

    def begin_losses(self, recipe: Recipe, device: torch.device) -> PanelState:
        """Begin what the losses remember: the augmentation, moving means, the gradient's norm; return the state."""
        self.augmentation = None if recipe.augmentation is None else recipe.augmentation.begin()
        self.begin_generated(recipe, device)
        return self

    def begin_generated(self, recipe: Recipe, device: torch.device) -> None:
        """Begin what is remembered of generated images."""
        given = recipe.matching
        self.matching = None if given is None else given.begin(some_images(self.panel)).to(device)
        self.gradient_norm = 0.0

    @property
    def penalty_scale(self) -> float:
        """The factor of the recipe's gradient penalty as of now."""
        return self.panel.penalty_scale * (self.augmentation.penalty_scale if self.augmentation else 1.0)

    def update(self, processes: Processes) -> None:
        """Update what the panel learns itself, after the backward pass of the generator's loss."""
        self.assignment.update(processes)
        if self.assignment.learned is not None:
            self.assignment.learned.update(processes)

    def log(self) -> dict[str, Any]:
        """Return fields for the lines of the log."""
        learned = self.assignment.learned
        return {
            **self.assignment.log(),
            **(learned.log() if learned else {}),
            **(self.augmentation.log() if self.augmentation else {}),
            **(self.matching.log() if self.matching else {}),
        }


class State:
    """Networks, averaged weights, optimisers, assignments and counters of a run, and what is kept of its best try."""

    def __init__(self, recipe: Recipe, device: torch.device) -> None:
        self.recipe, self.device = recipe, device
        self.counters = Counters()
        self.kept: dict[str, Tensor] = {}
        with seeded(recipe.seed, "weights"):
            self._build_networks(recipe)
            assignments = begin_assignments(recipe)
        self.panels = [
            PanelState(panel, discriminator, assignment.to(device)).begin_losses(recipe, device)
            for panel, discriminator, assignment in zip(recipe.panels, self.discriminators, assignments, strict=True)
        ]
        self.domain: Domain = domain_of(self.generator, recipe.domain)

    def _build_networks(self, recipe: Recipe) -> None:
        """Build generator and discriminators with new weights and optimisers."""
        generator = recipe.generator()
        if not isinstance(generator, Generator):
            raise UserError(f"generator: made a {type(generator).__name__}; make a subclass of up.Generator")
        self.generator = generator.to(self.device)
        if recipe.normalise_over == "processes":
            share_statistics(self.generator)
        heads = [panel.assignment.heads(panel) for panel in recipe.panels]
        built = [self._discriminator(panel.shape, count) for panel, count in zip(recipe.panels, heads, strict=True)]
        for discriminator in built:
            if getattr(discriminator, "group", ...) is None:
                vars(discriminator)["group"] = recipe.batch
        self.discriminators = nn.ModuleList([discriminator.to(self.device) for discriminator in built])
        self._learning = [p for p in self.discriminators.parameters() if p.requires_grad]
        if recipe.normalise_over == "processes":
            share_statistics(self.discriminators)
            if recipe.penalty is not None and shares_statistics(self.discriminators):
                raise UserError(
                    "normalise_over='processes': a gradient penalty cannot be differentiated through the batch "
                    "normalisation of the discriminator; leave out one of the two"
                )
        self.average: Generator = copy.deepcopy(self.generator).eval().requires_grad_(False)
        # Listed once: modules take milliseconds to list their parameters where they are many.
        self._averaged: tuple[list[Tensor], list[Tensor]] = (
            list(self.average.parameters()),
            list(self.generator.parameters()),
        )
        self.generator_optimiser = optimiser_of(self.generator, recipe.generator_optimiser)
        self.discriminator_optimiser = optimiser_of(self.discriminators, recipe.discriminator_optimiser)

    def _discriminator(self, shape: tuple[int, ...], heads: int) -> nn.Module:
        try:
            return self.recipe.discriminator(shape, heads)
        except TypeError as error:
            raise UserError(
                f"discriminator: called with (shape of one image, number of heads), {shape} and {heads}: {error}"
            ) from error

    def let_discriminators_learn(self, learn: bool) -> None:
        """Let gradients reach their parameters or not; those that were frozen when they were built stay so."""
        for parameter in self._learning:
            parameter.requires_grad_(learn)

    def restart(self) -> None:
        """Give generator and discriminators new weights, as the released code does after round 1."""
        with seeded(self.recipe.seed + 1, "weights"):
            self._build_networks(self.recipe)
        for panel, discriminator in zip(self.panels, self.discriminators, strict=True):
            panel.discriminator = discriminator
            panel.begin_generated(self.recipe, self.device)
        self.counters.began, self.counters.collapsed = self.counters.step, 0

    def keep(self, merit: float) -> None:
        """Keep the state as it is now, but for the counters."""
        self.counters.best_merit, self.counters.best_start = merit, self.counters.start
        self.kept = {name: value for name, value in self.tensors().items() if not name.startswith((COUNTERS, KEPT))}

    def begin_again(self, number: int, progress: float) -> None:
        """Begin a try at `progress` of the budget: from new weights, new assignments and new losses."""
        with seeded(self._seed_of(number), "weights"):
            self._build_networks(self.recipe)
            self._begin_assignments(number)
        for panel, discriminator in zip(self.panels, self.discriminators, strict=True):
            panel.discriminator = discriminator
            panel.begin_losses(self.recipe, self.device)
        self.go_on_from(progress)

    def go_on_from(self, progress: float) -> None:
        """Let augmentations count the budget from here on, whatever was spent of it meanwhile, or of another one."""
        for panel in self.panels:
            if panel.augmentation is not None:
                panel.augmentation.go_on_from(progress)

    def _begin_assignments(self, number: int) -> None:
        """Begin the assignments of a try, whose draws depend on its seed."""
        assignments = begin_assignments(self.recipe, self._seed_of(number))
        for panel, assignment in zip(self.panels, assignments, strict=True):
            panel.assignment = assignment.to(self.device)
        self.counters.start = number

    def _seed_of(self, number: int) -> int:
        return derived_seed(self.recipe.seed, number, "try") if number else self.recipe.seed

    def take_kept(self, progress: float) -> None:
        """Return, at `progress` of the budget, to the state that was kept, but for the counters."""
        self.counters.start = self.counters.best_start
        self.load({**self.kept, **self.counters.tensors()})
        self.kept = {}
        self.go_on_from(progress)

    def update_average(self, half_life: float) -> None:
        """Move the averaged weights towards the generator's.

        Early on the half-life is a tenth of the steps since the weights began, those of averages taken over among them;
        a half-life of 0 copies the weights.
        """
        steps = self.counters.averaged + self.counters.step - self.counters.began
        half_life = min(half_life, max(steps / 10, 1.0))
        rate = 1 - 0.5 ** (1 / half_life) if half_life else 1.0
        with torch.no_grad():
            mean, new = self._averaged
            torch._foreach_lerp_(mean, new, rate)  # pyright: ignore[reportPrivateImportUsage]
            held, now = list(self.average.buffers()), list(self.generator.buffers())
            if held:
                torch._foreach_copy_(held, now)  # pyright: ignore[reportPrivateImportUsage]

    def sampler(self) -> Generator:
        """Return the averaged generator as samples are drawn from it: with hulls if cameras are level by now."""
        self.average.hull = self.generator.hull
        own = {f"{prefix}/{k}": v for prefix, module in self.modules() for k, v in module.state_dict().items()}
        keep_hull_if_level(self.average, own)
        return self.average

    def modules(self) -> Iterator[tuple[str, nn.Module]]:
        yield "generator", self.generator
        yield "average", self.average
        yield "discriminators", self.discriminators
        for i, panel in enumerate(self.panels):
            yield f"panels/{i}/assignment", panel.assignment
            if panel.augmentation is not None:
                yield f"panels/{i}/augmentation", panel.augmentation
            if panel.matching is not None:
                yield f"panels/{i}/matching", panel.matching

    def optimisers(self) -> Iterator[tuple[str, TorchAdam]]:
        yield "generator_optimiser", self.generator_optimiser
        yield "discriminator_optimiser", self.discriminator_optimiser
        for i, panel in enumerate(self.panels):
            for name, optimiser in panel.assignment.optimisers().items():
                yield f"panels/{i}/optimisers/{name}", optimiser
            if panel.assignment.learned is not None:
                yield f"panels/{i}/learned_optimiser", panel.assignment.learned.adam

    def tensors(self) -> dict[str, Tensor]:
        """Return every number of the state by name, on the CPU: what a checkpoint stores."""
        named = {f"{prefix}/{k}": v for prefix, module in self.modules() for k, v in module.state_dict().items()}
        for prefix, optimiser in self.optimisers():
            named |= {f"{prefix}/{k}": v for k, v in optimiser_tensors(optimiser).items()}
        for i, panel in enumerate(self.panels):
            named[f"panels/{i}/gradient_norm"] = torch.tensor(panel.gradient_norm, dtype=torch.float64)
        kept = {f"{KEPT}{k}": v for k, v in self.kept.items()}
        return {
            k: v.detach().cpu().contiguous().clone() for k, v in {**named, **self.counters.tensors(), **kept}.items()
        }

    def load(self, tensors: dict[str, Tensor]) -> None:
        """Take over stored tensors. Raises UserError if they are not those of this recipe."""
        try:
            self._load(tensors)
        except KeyError as error:
            raise UserError(f"the checkpoint has no {error}; resume with the version that wrote it") from error

    def _load(self, tensors: dict[str, Tensor]) -> None:
        self.counters.load(tensors)
        with seeded(self._seed_of(self.counters.start), "weights"):
            self._begin_assignments(self.counters.start)
        for prefix, module in self.modules():
            load_module(module, tensors, prefix)
        for prefix, optimiser in self.optimisers():  # an assignment says which it has once its module is loaded
            load_optimiser(optimiser, stripped(tensors, prefix))
        for i, panel in enumerate(self.panels):
            panel.gradient_norm = tensors[f"panels/{i}/gradient_norm"].item()
        self.kept = {k.removeprefix(KEPT): v for k, v in tensors.items() if k.startswith(KEPT)}


def keep_hull_if_level(generator: Generator, tensors: Mapping[str, Tensor]) -> None:
    """Sample no hulls if a learned elevation is not level: cameras from above see concavities that those do not."""
    for name, mean in tensors.items():
        if name.endswith("/learned.latents.elevation.mean"):
            spread, begun = (tensors[name.removesuffix("mean") + other] for other in ("log_spread", "begun"))
            if bool(begun) and bool(mean.abs() + spread.exp() >= LEVEL):
                generator.hull = False


def begin_assignments(recipe: Recipe, seed: int | None = None) -> list[AssignmentState]:
    """Begin the assignment of each panel, with the recipe's seed or another."""
    seed = recipe.seed if seed is None else seed
    seeds = [seed if i == 0 else derived_seed(seed, i, "panel") for i in range(len(recipe.panels))]
    begun = [panel.assignment.begin(panel, seed) for panel, seed in zip(recipe.panels, seeds, strict=True)]
    if recipe.normalise_over == "processes":
        for state in begun:
            share_statistics(state)
    return begun


def load_module(module: nn.Module, tensors: dict[str, Tensor], prefix: str) -> None:
    """Load what is stored under `prefix`. Raises UserError if names or shapes are not the module's."""
    own = stripped(tensors, prefix)
    if {k: v.shape for k, v in module.state_dict().items()} != {k: v.shape for k, v in own.items()}:
        raise UserError(f"the checkpoint's {prefix} does not fit this recipe; it is of another run or another version")
    module.load_state_dict(own)


MEASURED = 2000
"""Real images at most whose statistics are matched."""


def some_images(panel: Panel) -> Tensor:
    """Return images of a panel, evenly spread over its collections."""
    return panel.batch(spread_rows(len(panel), MEASURED), torch.device("cpu")).float()


def stripped(tensors: dict[str, Tensor], prefix: str, further: str = "") -> dict[str, Tensor]:
    """Return what is stored under `prefix`, by the names within it; of these only those that begin with `further`."""
    start = f"{prefix}/{further}"
    return {k.removeprefix(start): v for k, v in tensors.items() if k.startswith(start)}
