"""The laws of projections: pure, batched, finite, differentiable, in latents too; linear: superposition, adjoint."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torch.autograd.gradcheck import GradcheckError, gradcheck

from .._random import generator_at
from ..projections.base import Projection
from ..projections.observation import Observation
from ..projections.priors import Product, Uniform
from .laws import Law, LawError, equal, global_seed, need, same

BATCH = 3
NUDGE = 1e-3
"""How far from what a prior draws derivatives by latents are compared."""


@dataclass(frozen=True)
class ProjectionCase:
    """A projection with a float64 batch to project."""

    projection: Projection
    x: Tensor
    theta: dict[str, Tensor]

    @property
    def given(self) -> str:
        """What an operator was called with, for one that raises."""
        return f", given x {tuple(self.x.shape)} of float64 (an operator of one size alone names it: `example_shape`)"

    def project(self, x: Tensor | None = None, rows: Any = slice(None), seed: int = 0) -> Tensor:
        """Return P(x, θ[rows]) of fresh copies, under a fixed global seed."""
        x = self.x[rows] if x is None else x
        theta = {name: value[rows].clone() for name, value in self.theta.items()}
        with global_seed(seed):
            return self.projection(x.clone(), **theta)


def projection_case(part: Projection | Observation, example: Tensor | None, seed: int) -> ProjectionCase:
    projection = part.projection if isinstance(part, Observation) else part
    prior = part.prior if isinstance(part, Observation) else Product(*(Uniform(n, 0, 1) for n in projection.latents))
    rng = generator_at(seed, 0, "laws")
    if example is None:
        # Mostly empty, as real volumes are: a nearly opaque one hides errors behind its first voxels.
        example = torch.rand(BATCH, *projection.example_shape, generator=rng) ** 3
    if len(example) < 2:  # of one element no law could tell what is mixed with the rest of a batch
        example = torch.cat([example, 0.7 * example.flip(-1)])
    theta = prior.sample(len(example), rng)
    return ProjectionCase(projection, example.double(), {name: value.double() for name, value in theta.items()})


def _shape(case: ProjectionCase) -> str:
    y = case.project()
    kind = f"{type(y).__name__} of {y.dtype}" if isinstance(y, Tensor) else type(y).__name__
    how = "; give real and imaginary parts as channels" if isinstance(y, Tensor) and y.is_complex() else ""
    need(isinstance(y, Tensor) and y.is_floating_point(), f"it returned {kind}, not floats{how}")
    need(y.dim() >= 2 and len(y) == len(case.x), f"{len(case.x)} went in and the result has shape {tuple(y.shape)}")
    return f"{tuple(case.x.shape)} to {tuple(y.shape)}"


def _dtype(case: ProjectionCase) -> str:
    y = case.project()
    need(y.dtype == torch.float64, f"float64 went in and {y.dtype} came out")
    return "float64 to float64"


def _pure(case: ProjectionCase) -> str:
    return same(case.project(seed=1), case.project(seed=2), 0.0, "two equal calls")


def _inputs(case: ProjectionCase) -> str:
    x, theta = case.x.clone(), {name: value.clone() for name, value in case.theta.items()}
    with global_seed(0):
        case.projection(x, **theta)
    need(torch.equal(x, case.x), "x was changed")
    changed = [name for name in theta if not torch.equal(theta[name], case.theta[name])]
    need(not changed, f"{', '.join(changed)} was changed")
    return "unchanged"


def _state(case: ProjectionCase) -> str:
    before = copy.deepcopy(vars(case.projection))
    case.project()
    changed = [k for k, v in vars(case.projection).items() if k not in before or not equal(v, before[k])]
    need(not changed, f"it wrote self.{', self.'.join(changed)}")
    return "no attribute written"


def _batched(case: ProjectionCase) -> str:
    y = case.project()
    alone = torch.cat([case.project(rows=slice(b, b + 1)) for b in range(len(case.x))])
    same(alone, y, 1e-9, "an element alone and in the batch")
    order = torch.arange(len(case.x)).flip(0)
    return same(case.project(rows=order), y[order], 1e-9, "the permuted batch and the permuted result")


def _finite(case: ProjectionCase) -> str:
    for name, x in (("random", case.x), ("all 0", torch.zeros_like(case.x)), ("all 1", torch.ones_like(case.x))):
        x = x.clone().requires_grad_()
        y = case.project(x)
        need(bool(y.isfinite().all()), f"the result is not finite for {name} x")
        if y.requires_grad:
            (gradient,) = torch.autograd.grad(y.sum(), x)
            need(bool(gradient.isfinite().all()), f"the gradient is not finite for {name} x")
    return "random, all 0 and all 1"


def _differentiable(case: ProjectionCase) -> str:
    x = case.x.clone().requires_grad_()
    y = case.project(x)
    need(y.requires_grad, "the result does not depend on x for autograd")
    weight = torch.rand(y.shape, generator=generator_at(1), dtype=y.dtype)
    (gradient,) = torch.autograd.grad(y, x, weight)
    need(bool(gradient.any()), "the gradient is 0 everywhere")
    _check_gradient(case.project, x, y)
    return "gradcheck in float64"


def _latents(case: ProjectionCase) -> str:
    found = []
    for name, value in case.theta.items():

        def project(value: Tensor, name: str = name) -> Tensor:
            return replace(case, theta={**case.theta, name: value}).project()

        # Aside of where samples of rays lie on voxels, as at elevation 0, which is a kink of interpolation.
        aside = NUDGE * torch.rand(value.shape, generator=generator_at(2), dtype=value.dtype)
        value = (value + aside).requires_grad_()
        y = project(value)
        if y.requires_grad:
            _check_gradient(project, value, y, f" of {name}")
            found.append(name)
    return f"of {', '.join(found)}, gradcheck in float64" if found else "none has a gradient"


def _check_gradient(function: Callable[[Tensor], Tensor], at: Tensor, y: Tensor, of: str = "") -> None:
    """Require the gradient of `function`, which is y there, to be the derivative by finite differences."""
    scale = y.detach().abs().max().clamp_min(1e-30)  # gradcheck's tolerance is absolute
    try:
        gradcheck(lambda value: function(value) / scale, (at,), fast_mode=True, nondet_tol=1e-9)
    except GradcheckError as error:
        raise LawError(f"gradcheck{of} says " + " ".join(str(error).split())[:200]) from error


def _superposition(case: ProjectionCase) -> str:
    if not case.projection.linear:
        return "not linear: does not apply"
    x, other = case.x, case.x.flip(0).square()
    combined = 2 * case.project(x) - 3 * case.project(other)
    return same(case.project(2 * x - 3 * other), combined, 1e-8, "P(2x - 3x') and 2P(x) - 3P(x')")


def _adjoint(case: ProjectionCase) -> str:
    if not case.projection.linear:
        return "not linear: does not apply"
    x = case.x.clone().requires_grad_()
    Ax = case.project(x) - case.project(torch.zeros_like(x))
    y = torch.rand(Ax.shape, generator=generator_at(1), dtype=Ax.dtype)
    if hasattr(case.projection, "adjoint"):
        ATy = case.projection.adjoint(y, **case.theta)  # pyright: ignore[reportAttributeAccessIssue]
    else:
        (ATy,) = torch.autograd.grad(Ax, x, y, retain_graph=True)
    return same((Ax * y).sum().detach(), (x * ATy).sum().detach(), 1e-8, "<Ax, y> and <x, Aᵀy>")


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
    Law("batched", "an element's result does not depend on the rest of the batch",
        "a mean, norm or batch-norm over the batch, or broadcasting θ along the wrong dimension", _batched),
    Law("finite", "values and gradients are finite, also for x all 0 and all 1",
        "a division, logarithm or root at its singular point", _finite),
    Law("differentiable", "the gradient in x is the derivative of the values",
        "a detach, round or comparison, .item() or numpy, or a hand-written backward", _differentiable),
    Law("latents", "where y has a gradient in a latent, it is the derivative of the values",
        "a hand-written backward, or a detach of a part that depends on θ; detach θ whole if it is not to be learned",
        _latents),
    Law("superposition", "P(ax + bx') = aP(x) + bP(x') where linear = True",
        "an offset, clamp or normalisation: set linear = False", _superposition),
    Law("adjoint", "<Ax, y> = <x, Aᵀy> where linear = True (Aᵀ is `adjoint` if defined, else autograd's)",
        "an adjoint without a weight or a reflection of the forward operator", _adjoint),
)  # fmt: skip
