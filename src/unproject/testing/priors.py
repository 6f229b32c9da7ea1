"""The laws of priors: names, shapes, determinism and support of their draws."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .._random import generator_at
from ..projections.priors import Prior
from .laws import Law, global_seed, need, same


@dataclass(frozen=True)
class PriorCase:
    """A prior and the seed of its draws."""

    prior: Prior
    seed: int

    def draw(self, n: int = 64, world: int = 0) -> dict[str, Tensor]:
        with global_seed(world):
            return self.prior.sample(n, generator_at(self.seed, 0, "laws"))


def _prior_names(case: PriorCase) -> str:
    names, drawn = case.prior.names, tuple(case.draw())
    need(len(set(names)) == len(names), f"the names {names} repeat")
    need(set(names) == set(drawn), f"the names are {names} and the draws {drawn}")
    return ", ".join(names) or "no latents"


def _prior_shape(case: PriorCase) -> str:
    for n in (1, 64):
        for name, value in case.draw(n).items():
            need(value.shape == (n,), f"{n} draws of {name} have the shape {tuple(value.shape)}")
    return "(1,) and (64,)"


def _prior_dtype(case: PriorCase) -> str:
    for name, value in case.draw().items():
        need(value.dtype == torch.float32, f"{name} is {value.dtype}")
    return "float32"


def _prior_finite(case: PriorCase) -> str:
    for name, value in case.draw(1024).items():
        need(bool(value.isfinite().all()), f"{name} has draws that are not finite")
    return "1024 draws"


def _prior_deterministic(case: PriorCase) -> str:
    first, second = case.draw(world=1), case.draw(world=2)
    for name in first:
        same(first[name], second[name], 0.0, f"two draws of {name} from the same state of rng")
    return "equal draws from equal states"


def _prior_support(case: PriorCase) -> str:
    draws = case.draw(1024)
    inside = case.prior.contains(draws) if draws else torch.ones(0, dtype=torch.bool)
    need(
        inside.dtype == torch.bool and inside.shape == (len(next(iter(draws.values()), ())),),
        f"contains() gives {inside.dtype} of shape {tuple(inside.shape)}, not a bool for each draw",
    )
    need(bool(inside.all()), f"{int((~inside).sum())} of 1024 draws lie outside")
    return "1024 draws inside"


PRIOR_LAWS: tuple[Law[PriorCase], ...] = (
    Law("names", "it draws the latents in `names`, each once", "names and sample disagree", _prior_names, first=True),
    Law("shape", "n draws of a latent have shape (n,)", "a trailing dimension", _prior_shape, first=True),
    Law("dtype", "draws are float32", "numpy or a float64 table", _prior_dtype),
    Law("finite", "draws are finite", "a logarithm of 0 or a division", _prior_finite),
    Law("deterministic", "equal states of rng give equal draws",
        "a draw without generator=rng", _prior_deterministic),
    Law("support", "contains() holds for every draw", "an angle compared without its period", _prior_support),
)  # fmt: skip
