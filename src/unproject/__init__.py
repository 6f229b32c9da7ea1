"""Learn generators of things you cannot measure directly from plain collections of their projections.

The four concepts are `Projection` (a pure function y = P(x, θ)), `Observation` (one way of looking: a
projection with a prior over θ), the assignment of images to ways of looking (`Known` or `Predicted`)
and `Recipe` (everything a training run is made of). Names are imported when they are first used, so
that `import unproject` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Projection": "unproject.projections.base",
    "Identity": "unproject.projections.base",
    "Silhouette": "unproject.projections.silhouette",
    "LineIntegral": "unproject.projections.line_integral",
    "Selection": "unproject.projections.selection",
    "Rendering": "unproject.projections.rendering",
    "Observation": "unproject.projections.observation",
    "Uniform": "unproject.projections.priors",
    "Bins": "unproject.projections.priors",
    "Product": "unproject.projections.priors",
    "Known": "unproject.adversarial.assignment",
    "Predicted": "unproject.adversarial.assignment",
    "Recipe": "unproject.training.recipe",
    "Collection": "unproject.data",
    "train": "unproject.training",
    "resume": "unproject.training",
    "load": "unproject.training",
}
_SUBMODULES = ("ops", "testing", "export")

__all__ = [*_HOME, *_SUBMODULES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
    elif name in _SUBMODULES:
        value = import_module(f"unproject.{name}")
    else:
        raise AttributeError(f"module 'unproject' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if TYPE_CHECKING:
    from . import export as export
    from . import ops as ops
    from . import testing as testing
    from .adversarial.assignment import Known as Known
    from .adversarial.assignment import Predicted as Predicted
    from .data import Collection as Collection
    from .projections.base import Identity as Identity
    from .projections.base import Projection as Projection
    from .projections.line_integral import LineIntegral as LineIntegral
    from .projections.observation import Observation as Observation
    from .projections.priors import Bins as Bins
    from .projections.priors import Product as Product
    from .projections.priors import Uniform as Uniform
    from .projections.rendering import Rendering as Rendering
    from .projections.selection import Selection as Selection
    from .projections.silhouette import Silhouette as Silhouette
    from .training import load as load
    from .training import resume as resume
    from .training import train as train
    from .training.recipe import Recipe as Recipe
