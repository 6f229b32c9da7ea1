"""The laws of generators: pure in evaluation mode, element by element, reproducible from a seed."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from .._random import generator_at
from .laws import Law, equal, global_seed, need, same

BATCH = 3


@dataclass(frozen=True)
class GeneratorCase:
    """A copy of a generator in evaluation mode, with a batch of codes."""

    generator: Any
    codes: Tensor
    low: float
    high: float

    def generate(self, codes: Tensor | None = None, seed: int = 0) -> Tensor:
        with global_seed(seed), torch.no_grad():
            return self.generator(self.codes if codes is None else codes)


def generator_case(generator: Any, seed: int, low: float, high: float) -> GeneratorCase:
    generator = copy.deepcopy(generator).eval()
    codes = generator.draw(BATCH, generator_at(seed, 0, "laws"))
    return GeneratorCase(generator, codes, low, high)


def _generator_shape(case: GeneratorCase) -> str:
    x = case.generate()
    need(isinstance(x, Tensor) and x.is_floating_point(), f"it returned {type(x).__name__}")
    need(x.dim() >= 2 and len(x) == len(case.codes), f"{len(case.codes)} codes gave the shape {tuple(x.shape)}")
    return f"{tuple(case.codes.shape)} to {tuple(x.shape)}"


def _generator_finite(case: GeneratorCase) -> str:
    for scale in (0.0, 1.0, 4.0):
        need(bool(case.generate(case.codes * scale).isfinite().all()), f"not finite for codes times {scale:g}")
    return "codes times 0, 1 and 4"


def _generator_range(case: GeneratorCase) -> str:
    x = case.generate()
    x = x[x.isfinite()]
    measured = f"{x.min():.4g} to {x.max():.4g}"
    need(bool((x >= case.low).all() and (x <= case.high).all()), f"values run from {measured}")
    return measured


def _generator_pure(case: GeneratorCase) -> str:
    before = copy.deepcopy(case.generator.state_dict())
    detail = same(case.generate(seed=1), case.generate(seed=2), 0.0, "two equal calls")
    changed = [k for k, v in case.generator.state_dict().items() if not equal(v, before[k])]
    need(not changed, f"the buffers {', '.join(changed)} were written")
    return detail


def _generator_alone(case: GeneratorCase) -> str:
    alone = torch.cat([case.generate(code[None]) for code in case.codes])
    return same(alone, case.generate(), 1e-4, "an element alone and in the batch")


def _generator_seeded(case: GeneratorCase) -> str:
    with global_seed(1):
        three, other = case.generator.sample(3, seed=7), case.generator.sample(3, seed=8)
    with global_seed(2):
        two = case.generator.sample(2, seed=7)
    need(not torch.equal(three, other), "seeds 7 and 8 give the same samples")
    return same(three[:2], two, 1e-4, "sample(3, seed=7)[:2] and sample(2, seed=7)")


def _generator_trainable(case: GeneratorCase) -> str:
    generator = copy.deepcopy(case.generator).train()
    with global_seed(0):
        generator(case.codes).square().sum().backward()
    wanted = {name: p.grad for name, p in generator.named_parameters() if p.requires_grad}
    missing = [name for name, gradient in wanted.items() if gradient is None or not gradient.isfinite().all()]
    need(not missing, f"no finite gradient reaches {', '.join(missing)}")
    return f"{len(wanted)} parameters"


GENERATOR_LAWS: tuple[Law[GeneratorCase], ...] = (
    Law("shape", "n codes give n results", "a missing batch dimension", _generator_shape, first=True),
    Law("finite", "results are finite", "an exponential or a division without a bound", _generator_finite),
    Law("range", "values keep to their range", "no sigmoid or tanh at the end", _generator_range),
    Law("pure", "in evaluation mode the same codes give the same result and no buffer is written",
        "functional dropout or noise without `training=self.training`", _generator_pure),
    Law("alone", "in evaluation mode each element is generated alone",
        "batch norm with the batch's own statistics", _generator_alone),
    Law("seeded", "sample i depends on (seed, i) alone", "codes drawn from global randomness", _generator_seeded),
    Law("trainable", "every parameter receives a finite gradient",
        "a detach, or a layer that is not used", _generator_trainable),
)  # fmt: skip
