"""State: everything a step changes, and nothing else; what a checkpoint holds."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.optim import Adam as TorchAdam

from .._random import seeded
from .._types import UserError
from ..adversarial.assignment import Predicted, predictor_optimiser
from ..adversarial.learned_prior import LearnedPrior
from ..networks import Generator
from .panel import build_panels
from .recipe import Adam, Recipe


@dataclass
class Counters:
    """The numbers of a state.

    `round` is the rounds of assignment done, `fitting` the one whose predictor is being fitted, or 0, and `fitted` the
    steps of that; `rescues` the returns to a checkpoint, `lines` those of stats.jsonl.
    """

    step: int = 0
    round: int = 0
    fitting: int = 0
    fitted: int = 0
    rescues: int = 0
    dull: int = 0
    lines: int = 0
    seconds: float = 0.0
    rate_scale: float = 1.0


class State:
    """Networks, averaged weights, optimisers, assignments and counters of a run."""

    def __init__(self, recipe: Recipe, device: torch.device) -> None:
        self.counters = Counters()
        self.device = device
        with seeded(recipe.seed, "weights"):
            self.generator = recipe.generator().to(device)
            self.panels = build_panels(recipe)
            self.predictor = self._new_predictor(recipe)
        self.predictor_optimiser: TorchAdam | None = None  # while a predictor is being fitted
        self.assignment = recipe.assignment
        for panel in self.panels:
            panel.discriminator.to(device)
        self.average: Generator = copy.deepcopy(self.generator).eval().requires_grad_(False)
        self.generator_optimiser = _optimiser(self.generator, recipe.generator_optimiser)
        self.discriminators = nn.ModuleList([panel.discriminator for panel in self.panels])
        self.discriminator_optimiser = _optimiser(self.discriminators, recipe.discriminator_optimiser)
        self.way_distribution = self.panels[0].distribution
        self.way_optimiser: TorchAdam | None = None
        if isinstance(recipe.assignment, LearnedPrior) and self.way_distribution is not None:
            self.way_distribution.to(device)
            self.way_optimiser = TorchAdam(self.way_distribution.parameters(), recipe.assignment.rate, (0.5, 0.99))

    def _new_predictor(self, recipe: Recipe) -> nn.Module | None:
        if not isinstance(recipe.assignment, Predicted):
            return None
        panel = self.panels[0]
        return recipe.assignment.predictor(panel.shape, len(panel.observations)).to(self.device)

    def begin_fit(self, recipe: Recipe, round_: int) -> None:
        """Begin to fit the predictor of a round; with new weights, if each round trains it from scratch."""
        if isinstance(recipe.assignment, Predicted) and recipe.assignment.fresh:
            with seeded(recipe.seed, f"predictor/{round_}"):
                self.predictor = self._new_predictor(recipe)
        self.counters.fitting, self.counters.fitted = round_, 0
        self._renew_predictor_optimiser()

    def end_fit(self) -> None:
        self.counters.round, self.counters.fitting, self.counters.fitted = self.counters.fitting, 0, 0
        self.predictor_optimiser = None

    def _renew_predictor_optimiser(self) -> None:
        self.predictor_optimiser = None
        if isinstance(self.assignment, Predicted) and self.predictor is not None and self.counters.fitting:
            self.predictor_optimiser = predictor_optimiser(self.predictor, self.assignment)

    def restart(self, recipe: Recipe) -> None:
        """Fresh generator and discriminators, as the released code does for round 1; assignments are kept."""
        fresh = State(recipe.replace(seed=recipe.seed + 1), self.device)
        self.generator, self.average = fresh.generator, fresh.average
        for panel, new in zip(self.panels, fresh.panels, strict=True):
            panel.discriminator = new.discriminator
        self.discriminators = fresh.discriminators
        self.generator_optimiser = fresh.generator_optimiser
        self.discriminator_optimiser = fresh.discriminator_optimiser

    def update_average(self, half_life: float) -> None:
        """Move the averaged weights towards the generator's; early on the half-life is a tenth of the step."""
        half_life = min(half_life, max(self.counters.step / 10, 1.0))
        with torch.no_grad():
            for mean, new in zip(self.average.parameters(), self.generator.parameters(), strict=True):
                mean.lerp_(new, 1 - 0.5 ** (1 / half_life))
            for mean, new in zip(self.average.buffers(), self.generator.buffers(), strict=True):
                mean.copy_(new)

    def modules(self) -> Iterator[tuple[str, nn.Module]]:
        yield "generator", self.generator
        yield "average", self.average
        yield "discriminators", self.discriminators
        if self.predictor is not None:
            yield "predictor", self.predictor
        if self.way_distribution is not None:
            yield "way_distribution", self.way_distribution

    def tensors(self) -> dict[str, Tensor]:
        """Every number of the state by name, on the CPU: what a checkpoint stores."""
        named = {f"{prefix}/{k}": v for prefix, module in self.modules() for k, v in module.state_dict().items()}
        for prefix, optimiser in self._optimisers():
            named |= {f"{prefix}/{k}": v for k, v in _optimiser_tensors(optimiser).items()}
        for i, panel in enumerate(self.panels):
            named |= {f"panels/{i}/ways": panel.ways, f"panels/{i}/heads": panel.heads}
            named[f"panels/{i}/pull"] = torch.tensor(panel.pull, dtype=torch.float64)
        counters = {f"counters/{k}": torch.tensor(v, dtype=torch.float64) for k, v in vars(self.counters).items()}
        return {k: v.detach().cpu().contiguous().clone() for k, v in {**named, **counters}.items()}

    def load(self, tensors: dict[str, Tensor]) -> None:
        """Take over stored tensors. Raises UserError if they are not those of this recipe."""
        try:
            self._load(tensors)
        except KeyError as error:
            raise UserError(f"the checkpoint has no {error}; resume with the version that wrote it") from error

    def _load(self, tensors: dict[str, Tensor]) -> None:
        for name, value in vars(self.counters).items():
            setattr(self.counters, name, type(value)(tensors[f"counters/{name}"].item()))
        self._renew_predictor_optimiser()
        for prefix, module in self.modules():
            own = _strip(tensors, prefix)
            wanted = {k: v.shape for k, v in module.state_dict().items()}
            if wanted != {k: v.shape for k, v in own.items()}:
                raise UserError(f"the checkpoint's {prefix} does not fit this recipe; it belongs to another run")
            module.load_state_dict(own)
        for prefix, optimiser in self._optimisers():
            _load_optimiser(optimiser, _strip(tensors, prefix))
        for i, panel in enumerate(self.panels):
            if tensors[f"panels/{i}/ways"].shape != panel.ways.shape:
                raise UserError("the checkpoint was made with another number of images; it belongs to another run")
            panel.ways, panel.heads = tensors[f"panels/{i}/ways"], tensors[f"panels/{i}/heads"]
            panel.pull = tensors[f"panels/{i}/pull"].item()

    def _optimisers(self) -> Iterator[tuple[str, TorchAdam]]:
        yield "generator_optimiser", self.generator_optimiser
        yield "discriminator_optimiser", self.discriminator_optimiser
        if self.way_optimiser is not None:
            yield "way_optimiser", self.way_optimiser
        if self.predictor_optimiser is not None:
            yield "predictor_optimiser", self.predictor_optimiser


def _optimiser(module: nn.Module, settings: Adam) -> TorchAdam:
    return TorchAdam(module.parameters(), settings.rate, (settings.beta1, settings.beta2))


def _strip(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {k.removeprefix(f"{prefix}/"): v for k, v in tensors.items() if k.startswith(f"{prefix}/")}


def _optimiser_tensors(optimiser: TorchAdam) -> dict[str, Tensor]:
    moments = optimiser.state_dict()["state"]
    return {f"{i}/{name}": torch.as_tensor(v) for i, entry in moments.items() for name, v in entry.items()}


def _load_optimiser(optimiser: TorchAdam, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        index, name = key.split("/")
        state.setdefault(int(index), {})[name] = value
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
