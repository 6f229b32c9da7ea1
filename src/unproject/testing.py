"""The laws that projections, priors and generators obey, for the shipped parts and for a user's own.

Each law is one line of a table: what must hold, what it looks like when it does not, and a test. `check_*` raises
`LawError` with every broken law; `run_laws` returns all the results, as `unproject check` prints them.
"""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.autograd.gradcheck import GradcheckError, gradcheck

from ._random import generator_at
from ._types import UserError
from .projections.base import Projection
from .projections.observation import Observation
from .projections.priors import Prior, Product, Uniform

BATCH = 3
Case = TypeVar("Case")


class LawError(AssertionError):
    """A part breaks a law; the message names the law, what was measured and the likely cause."""


class LawResult(NamedTuple):
    """One law applied to one part."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True)
class Law(Generic[Case]):
    """`test` returns what it measured and raises `LawError` if that breaks the law.

    If a `first` law is broken, the later ones cannot be judged and are not tried.
    """

    name: str
    statement: str
    cause: str
    test: Callable[[Case], str]
    first: bool = False

    def apply(self, case: Case) -> LawResult:
        try:
            return LawResult(self.name, True, f"{self.statement} ({self.test(case)})")
        except Exception as error:
            measured = str(error) if isinstance(error, LawError) else f"{type(error).__name__}: {error}"
            return LawResult(self.name, False, f"{self.statement}; but {measured}. Likely cause: {self.cause}")


def check_projection(part: Projection | Observation, example: Tensor | None = None, seed: int = 0) -> None:
    """Test the laws of a projection.

    Args:
        part: a projection, its latents then drawn from U[0, 1); or an observation, which draws its own.
        example: a batch of x; by default three random ones of the projection's `example_shape`, values in [0, 1].

    Raises:
        LawError: naming each broken law, what was measured and the likely cause.
    """
    _raise_broken(part, _apply(PROJECTION_LAWS, _projection_case(part, example, seed)))


def check_prior(prior: Prior, seed: int = 0) -> None:
    """Test the laws of a prior; raises `LawError`."""
    _raise_broken(prior, _apply(PRIOR_LAWS, PriorCase(prior, seed)))


def check_generator(generator: nn.Module, seed: int = 0, low: float = 0.0, high: float = 1.0) -> None:
    """Test the laws of a generator, a module with `draw(n, rng)` and `sample(n, seed)`; raises `LawError`.

    Args:
        low, high: the range its values must keep to.
    """
    _raise_broken(generator, _apply(GENERATOR_LAWS, _generator_case(generator, seed, low, high)))


def run_laws(part: Any, seed: int = 0) -> list[LawResult]:
    """All laws that apply to a projection, an observation (with its prior), a prior or a generator."""
    if isinstance(part, Observation):
        return run_laws(part.prior, seed) + _apply(PROJECTION_LAWS, _projection_case(part, None, seed))
    if isinstance(part, Projection):
        return _apply(PROJECTION_LAWS, _projection_case(part, None, seed))
    if isinstance(part, Prior):
        return _apply(PRIOR_LAWS, PriorCase(part, seed))
    if isinstance(part, nn.Module):
        return _apply(GENERATOR_LAWS, _generator_case(part, seed, 0.0, 1.0))
    raise UserError(f"{part!r} is none of Projection, Observation, Prior or generator module; give one of those")


def _apply(laws: Sequence[Law[Case]], case: Case) -> list[LawResult]:
    results = []
    for law in laws:
        results.append(law.apply(case))
        if law.first and not results[-1].passed:
            break
    return results


def _raise_broken(part: Any, results: list[LawResult]) -> None:
    broken = [f"- {r.name}: {r.detail}" for r in results if not r.passed]
    if broken:
        raise LawError("\n".join([f"{type(part).__name__} breaks {len(broken)} of {len(results)} laws tried", *broken]))


# Projections


@dataclass(frozen=True)
class ProjectionCase:
    """A projection with a float64 batch to look at."""

    projection: Projection
    x: Tensor
    theta: dict[str, Tensor]

    def look(self, x: Tensor | None = None, rows: Any = slice(None), seed: int = 0) -> Tensor:
        """y = P(x, θ[rows]) on fresh copies, under a fixed global seed."""
        x = self.x[rows] if x is None else x
        theta = {name: value[rows].clone() for name, value in self.theta.items()}
        with _global_seed(seed):
            return self.projection(x.clone(), **theta)


def _projection_case(part: Projection | Observation, example: Tensor | None, seed: int) -> ProjectionCase:
    projection = part.projection if isinstance(part, Observation) else part
    prior = part.prior if isinstance(part, Observation) else Product(*(Uniform(n, 0, 1) for n in projection.latents))
    rng = generator_at(seed, 0, "laws")
    if example is None:
        # Mostly empty, as real volumes are: a nearly opaque one hides mistakes behind its first voxels.
        example = torch.rand(BATCH, *projection.example_shape, generator=rng) ** 3
    theta = prior.sample(len(example), rng)
    return ProjectionCase(projection, example.double(), {name: value.double() for name, value in theta.items()})


def _shape(case: ProjectionCase) -> str:
    y = case.look()
    _need(isinstance(y, Tensor) and y.is_floating_point(), f"it returned {type(y).__name__}")
    _need(y.dim() >= 2 and len(y) == len(case.x), f"{len(case.x)} went in and the result has shape {tuple(y.shape)}")
    return f"{tuple(case.x.shape)} to {tuple(y.shape)}"


def _dtype(case: ProjectionCase) -> str:
    y = case.look()
    _need(y.dtype == torch.float64, f"float64 went in and {y.dtype} came out")
    return "float64 to float64"


def _pure(case: ProjectionCase) -> str:
    return _same(case.look(seed=1), case.look(seed=2), 0.0, "two equal calls")


def _inputs(case: ProjectionCase) -> str:
    x, theta = case.x.clone(), {name: value.clone() for name, value in case.theta.items()}
    with _global_seed(0):
        case.projection(x, **theta)
    _need(torch.equal(x, case.x), "x was changed")
    changed = [name for name in theta if not torch.equal(theta[name], case.theta[name])]
    _need(not changed, f"{', '.join(changed)} was changed")
    return "unchanged"


def _state(case: ProjectionCase) -> str:
    before = copy.deepcopy(vars(case.projection))
    case.look()
    changed = [k for k, v in vars(case.projection).items() if k not in before or not _equal(v, before[k])]
    _need(not changed, f"it wrote self.{', self.'.join(changed)}")
    return "no attribute written"


def _batched(case: ProjectionCase) -> str:
    y = case.look()
    alone = torch.cat([case.look(rows=slice(b, b + 1)) for b in range(len(case.x))])
    _same(alone, y, 1e-9, "an element alone and in the batch")
    order = torch.arange(len(case.x)).flip(0)
    return _same(case.look(rows=order), y[order], 1e-9, "the permuted batch and the permuted result")


def _finite(case: ProjectionCase) -> str:
    for name, x in (("random", case.x), ("all 0", torch.zeros_like(case.x)), ("all 1", torch.ones_like(case.x))):
        x = x.clone().requires_grad_()
        y = case.look(x)
        _need(bool(y.isfinite().all()), f"the result is not finite for {name} x")
        if y.requires_grad:
            (gradient,) = torch.autograd.grad(y.sum(), x)
            _need(bool(gradient.isfinite().all()), f"the gradient is not finite for {name} x")
    return "random, all 0 and all 1"


def _differentiable(case: ProjectionCase) -> str:
    x = case.x.clone().requires_grad_()
    y = case.look(x)
    _need(y.requires_grad, "the result does not depend on x for autograd")
    weight = torch.rand(y.shape, generator=generator_at(1), dtype=y.dtype)
    (gradient,) = torch.autograd.grad(y, x, weight)
    _need(bool(gradient.any()), "the gradient is 0 everywhere, so nothing can be learned through it")
    try:
        gradcheck(case.look, (x,), fast_mode=True, nondet_tol=1e-9)
    except GradcheckError as error:
        raise LawError("gradcheck says " + " ".join(str(error).split())[:200]) from error
    return "gradcheck in float64"


def _superposition(case: ProjectionCase) -> str:
    if not case.projection.linear:
        return "not linear: nothing to hold"
    x, other = case.x, case.x.flip(0).square()
    combined = 2 * case.look(x) - 3 * case.look(other)
    return _same(case.look(2 * x - 3 * other), combined, 1e-8, "P(2x - 3x') and 2P(x) - 3P(x')")


def _adjoint(case: ProjectionCase) -> str:
    if not case.projection.linear:
        return "not linear: nothing to hold"
    x = case.x.clone().requires_grad_()
    Ax = case.look(x) - case.look(torch.zeros_like(x))
    y = torch.rand(Ax.shape, generator=generator_at(1), dtype=Ax.dtype)
    if hasattr(case.projection, "adjoint"):
        ATy = case.projection.adjoint(y, **case.theta)  # pyright: ignore[reportAttributeAccessIssue]
    else:
        (ATy,) = torch.autograd.grad(Ax, x, y, retain_graph=True)
    return _same((Ax * y).sum().detach(), (x * ATy).sum().detach(), 1e-8, "<Ax, y> and <x, Aᵀy>")


PROJECTION_LAWS: tuple[Law[ProjectionCase], ...] = (
    Law("shape", "a batch gives a batch of the same length",
        "a missing batch dimension, or a sum over it", _shape, first=True),
    Law("dtype", "the result has the dtype of x",
        "a tensor or a cast of fixed dtype inside forward; write .to(x)", _dtype, first=True),
    Law("pure", "the same x and θ give the same y",
        "a draw from global randomness, or a counter; draw it in the prior and take it as a latent", _pure),
    Law("inputs", "x and θ are not modified",
        "an in-place operation (a name that ends in _) on an argument", _inputs),
    Law("state", "no attribute changes in a call",
        "self.something = ... inside forward", _state),
    Law("batched", "each element is treated alone, wherever in the batch it is",
        "a mean, norm or batch-norm over the batch, or broadcasting θ along the wrong dimension", _batched),
    Law("finite", "values and gradients are finite, also for x all 0 and all 1",
        "a division, logarithm or root at its singular point", _finite),
    Law("differentiable", "the gradient in x is the slope of the values",
        "a detach, round or comparison, .item() or numpy, or a hand-written backward", _differentiable),
    Law("superposition", "P(ax + bx') = aP(x) + bP(x') where linear = True",
        "an offset, clamp or normalisation: set linear = False", _superposition),
    Law("adjoint", "<Ax, y> = <x, Aᵀy> where linear = True (Aᵀ is `adjoint` if defined, else autograd's)",
        "an adjoint that forgets a weight or a mirror", _adjoint),
)  # fmt: skip


# Priors


@dataclass(frozen=True)
class PriorCase:
    """A prior and the seed of its draws."""

    prior: Prior
    seed: int

    def draw(self, n: int = 64, global_seed: int = 0) -> dict[str, Tensor]:
        with _global_seed(global_seed):
            return self.prior.sample(n, generator_at(self.seed, 0, "laws"))


def _prior_names(case: PriorCase) -> str:
    names, drawn = case.prior.names, tuple(case.draw())
    _need(len(set(names)) == len(names), f"the names {names} repeat")
    _need(set(names) == set(drawn), f"the names are {names} and the draws {drawn}")
    return ", ".join(names) or "no latents"


def _prior_shape(case: PriorCase) -> str:
    for n in (1, 64):
        for name, value in case.draw(n).items():
            _need(value.shape == (n,), f"{n} draws of {name} have the shape {tuple(value.shape)}")
    return "(1,) and (64,)"


def _prior_dtype(case: PriorCase) -> str:
    for name, value in case.draw().items():
        _need(value.dtype == torch.float32, f"{name} is {value.dtype}")
    return "float32"


def _prior_finite(case: PriorCase) -> str:
    for name, value in case.draw(1024).items():
        _need(bool(value.isfinite().all()), f"{name} has draws that are not finite")
    return "1024 draws"


def _prior_deterministic(case: PriorCase) -> str:
    first, second = case.draw(global_seed=1), case.draw(global_seed=2)
    for name in first:
        _same(first[name], second[name], 0.0, f"two draws of {name} from the same state of rng")
    return "equal draws from equal states"


def _prior_support(case: PriorCase) -> str:
    draws = case.draw(1024)
    inside = case.prior.contains(draws) if draws else torch.ones(0, dtype=torch.bool)
    _need(bool(inside.all()), f"{int((~inside).sum())} of 1024 draws lie outside")
    return "1024 draws inside"


PRIOR_LAWS: tuple[Law[PriorCase], ...] = (
    Law("names", "it draws the latents it names, each once", "names and sample disagree", _prior_names, first=True),
    Law("shape", "n draws of a latent have shape (n,)", "a trailing dimension", _prior_shape, first=True),
    Law("dtype", "draws are float32", "numpy or a float64 table", _prior_dtype),
    Law("finite", "draws are finite", "a logarithm of 0 or a division", _prior_finite),
    Law("deterministic", "equal states of rng give equal draws",
        "a draw without generator=rng", _prior_deterministic),
    Law("support", "contains() holds for every draw", "an angle compared without its period", _prior_support),
)  # fmt: skip


# Generators


@dataclass(frozen=True)
class GeneratorCase:
    """A copy of a generator in evaluation mode, with a batch of codes."""

    generator: Any
    codes: Tensor
    low: float
    high: float

    def make(self, codes: Tensor | None = None, seed: int = 0) -> Tensor:
        with _global_seed(seed), torch.no_grad():
            return self.generator(self.codes if codes is None else codes)


def _generator_case(generator: Any, seed: int, low: float, high: float) -> GeneratorCase:
    generator = copy.deepcopy(generator).eval()
    codes = generator.draw(BATCH, generator_at(seed, 0, "laws"))
    return GeneratorCase(generator, codes, low, high)


def _generator_shape(case: GeneratorCase) -> str:
    x = case.make()
    _need(isinstance(x, Tensor) and x.is_floating_point(), f"it returned {type(x).__name__}")
    _need(x.dim() >= 2 and len(x) == len(case.codes), f"{len(case.codes)} codes gave the shape {tuple(x.shape)}")
    return f"{tuple(case.codes.shape)} to {tuple(x.shape)}"


def _generator_finite(case: GeneratorCase) -> str:
    for scale in (0.0, 1.0, 4.0):
        _need(bool(case.make(case.codes * scale).isfinite().all()), f"not finite for codes times {scale:g}")
    return "codes times 0, 1 and 4"


def _generator_range(case: GeneratorCase) -> str:
    x = case.make()
    x = x[x.isfinite()]
    measured = f"{x.min():.4g} to {x.max():.4g}"
    _need(bool((x >= case.low).all() and (x <= case.high).all()), f"values run from {measured}")
    return measured


def _generator_pure(case: GeneratorCase) -> str:
    before = copy.deepcopy(case.generator.state_dict())
    detail = _same(case.make(seed=1), case.make(seed=2), 0.0, "two equal calls")
    changed = [k for k, v in case.generator.state_dict().items() if not _equal(v, before[k])]
    _need(not changed, f"the buffers {', '.join(changed)} were written")
    return detail


def _generator_alone(case: GeneratorCase) -> str:
    alone = torch.cat([case.make(code[None]) for code in case.codes])
    return _same(alone, case.make(), 1e-4, "an element alone and in the batch")


def _generator_seeded(case: GeneratorCase) -> str:
    with _global_seed(1):
        three, other = case.generator.sample(3, seed=7), case.generator.sample(3, seed=8)
    with _global_seed(2):
        two = case.generator.sample(2, seed=7)
    _need(not torch.equal(three, other), "seeds 7 and 8 give the same samples")
    return _same(three[:2], two, 1e-4, "sample(3, seed=7)[:2] and sample(2, seed=7)")


def _generator_trainable(case: GeneratorCase) -> str:
    generator = copy.deepcopy(case.generator).train()
    with _global_seed(0):
        generator(case.codes).square().sum().backward()
    wanted = {name: p.grad for name, p in generator.named_parameters() if p.requires_grad}
    missing = [name for name, gradient in wanted.items() if gradient is None or not gradient.isfinite().all()]
    _need(not missing, f"no finite gradient reaches {', '.join(missing)}")
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


def _need(holds: bool, otherwise: str) -> None:
    if not holds:
        raise LawError(otherwise)


def _same(a: Tensor, b: Tensor, tolerance: float, what: str) -> str:
    """a = b within `tolerance` relative to the largest value; NaN equals NaN, finiteness having its own law."""
    _need(a.shape == b.shape, f"{what} have the shapes {tuple(a.shape)} and {tuple(b.shape)}")
    both = a.isfinite() & b.isfinite()
    error = (a[both] - b[both]).abs().max().item() if both.any() else 0.0
    bound = tolerance * max(1.0, b[both].abs().max().item() if both.any() else 0.0)
    _need(error <= bound and bool((a.isfinite() == b.isfinite()).all()), f"{what} differ by {error:.3g}")
    return f"largest difference {error:.1g}"


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, Tensor) and isinstance(b, Tensor):
        return a.shape == b.shape and bool(((a == b) | ((a != a) & (b != b))).all())
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_equal(a[k], b[k]) for k in a)
    if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        return len(a) == len(b) and all(map(_equal, a, b))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(np.asarray(a), np.asarray(b))
    # A deep copy of an object without __eq__ never equals it: what it holds decides.
    return _equal(vars(a), vars(b)) if _plain_object(a) and type(a) is type(b) else bool(a == b)


def _plain_object(value: Any) -> bool:
    return type(value).__eq__ is object.__eq__ and hasattr(value, "__dict__") and not callable(value)


@contextmanager
def _global_seed(seed: int) -> Iterator[None]:
    """Fix what torch, numpy and Python draw from when no generator is given; put it back afterwards."""
    python, numpy = random.getstate(), np.random.get_state()
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            random.seed(seed)
            np.random.seed(seed)
            yield
    finally:
        random.setstate(python)
        np.random.set_state(numpy)
