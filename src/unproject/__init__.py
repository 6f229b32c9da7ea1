"""Learn generators of shapes, images and materials from unpaired collections of their projections.

The concepts are `Projection` (a pure function y = P(x, θ)), `Observation` (a projection with a prior over θ), `Panel`
(observations that share a discriminator, with their data), `Assignment` (which observation made each image), `Domain`
(what the generator makes) and `Recipe` (everything that decides what a run computes). Names are imported when they are
first used, so that `import unproject` costs nothing.
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
    "Prior": "unproject.projections.priors",
    "Uniform": "unproject.projections.priors",
    "Bins": "unproject.projections.priors",
    "Cap": "unproject.projections.priors",
    "Product": "unproject.projections.priors",
    "Mixture": "unproject.projections.priors",
    "Empirical": "unproject.projections.priors",
    "Panel": "unproject.assignment",
    "Assignment": "unproject.assignment",
    "AssignmentState": "unproject.assignment",
    "Known": "unproject.assignment",
    "Predicted": "unproject.assignment",
    "JointlyPredicted": "unproject.assignment",
    "LearnedLatent": "unproject.assignment",
    "LearnedPrior": "unproject.assignment",
    "Unassigned": "unproject.assignment",
    "Rounds": "unproject.assignment",
    "PredictorFit": "unproject.assignment",
    "Estimator": "unproject.assignment",
    "GaussianInitialiser": "unproject.assignment",
    "MeanShapeInitialiser": "unproject.assignment",
    "Domain": "unproject.domains",
    "Volumes": "unproject.domains",
    "Images": "unproject.domains",
    "Maps": "unproject.domains",
    "Loss": "unproject.adversarial.losses",
    "Relativistic": "unproject.adversarial.losses",
    "Wasserstein": "unproject.adversarial.losses",
    "Hinge": "unproject.adversarial.losses",
    "Logistic": "unproject.adversarial.losses",
    "Matching": "unproject.adversarial.matching",
    "Penalty": "unproject.adversarial.penalties",
    "R1R2": "unproject.adversarial.penalties",
    "GradientPenalty": "unproject.adversarial.penalties",
    "Augmentation": "unproject.adversarial.augmentation",
    "Adaptive": "unproject.adversarial.adaptive",
    "Affine": "unproject.adversarial.augmentation",
    "Shift": "unproject.adversarial.augmentation",
    "Axisymmetric": "unproject.adversarial.axisymmetric",
    "Centred": "unproject.adversarial.regularisers",
    "Connected": "unproject.adversarial.regularisers",
    "Inflated": "unproject.adversarial.inflated",
    "Rectilinear": "unproject.adversarial.regularisers",
    "Regularisers": "unproject.adversarial.regularisers",
    "Sometimes": "unproject.adversarial.augmentation",
    "Solid": "unproject.adversarial.regularisers",
    "Varied": "unproject.adversarial.regularisers",
    "Generator": "unproject.networks",
    "Collection": "unproject.data",
    "Coarse": "unproject.training",
    "Recipe": "unproject.training",
    "Options": "unproject.training",
    "Adam": "unproject.training",
    "Run": "unproject.training",
    "Tries": "unproject.training",
    "resumable": "unproject.training",
    "train": "unproject.training",
    "resume": "unproject.training",
    "load": "unproject.training",
    "from_pretrained": "unproject.sharing",
    "push_to_hub": "unproject.sharing",
    "UserError": "unproject._types",
}
_SUBMODULES = (
    "adversarial",
    "assignment",
    "data",
    "domains",
    "export",
    "inversion",
    "metrics",
    "networks",
    "ops",
    "projections",
    "recipes",
    "report",
    "sharing",
    "testing",
    "training",
)

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
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


if TYPE_CHECKING:
    from . import adversarial as adversarial
    from . import assignment as assignment
    from . import data as data
    from . import domains as domains
    from . import export as export
    from . import inversion as inversion
    from . import metrics as metrics
    from . import networks as networks
    from . import ops as ops
    from . import projections as projections
    from . import recipes as recipes
    from . import report as report
    from . import sharing as sharing
    from . import testing as testing
    from . import training as training
    from ._types import UserError as UserError
    from .adversarial.adaptive import Adaptive as Adaptive
    from .adversarial.augmentation import Affine as Affine
    from .adversarial.augmentation import Augmentation as Augmentation
    from .adversarial.augmentation import Shift as Shift
    from .adversarial.augmentation import Sometimes as Sometimes
    from .adversarial.axisymmetric import Axisymmetric as Axisymmetric
    from .adversarial.inflated import Inflated as Inflated
    from .adversarial.losses import Hinge as Hinge
    from .adversarial.losses import Logistic as Logistic
    from .adversarial.losses import Loss as Loss
    from .adversarial.losses import Relativistic as Relativistic
    from .adversarial.losses import Wasserstein as Wasserstein
    from .adversarial.matching import Matching as Matching
    from .adversarial.penalties import R1R2 as R1R2
    from .adversarial.penalties import GradientPenalty as GradientPenalty
    from .adversarial.penalties import Penalty as Penalty
    from .adversarial.regularisers import Centred as Centred
    from .adversarial.regularisers import Connected as Connected
    from .adversarial.regularisers import Rectilinear as Rectilinear
    from .adversarial.regularisers import Regularisers as Regularisers
    from .adversarial.regularisers import Solid as Solid
    from .adversarial.regularisers import Varied as Varied
    from .assignment import Assignment as Assignment
    from .assignment import AssignmentState as AssignmentState
    from .assignment import Estimator as Estimator
    from .assignment import GaussianInitialiser as GaussianInitialiser
    from .assignment import JointlyPredicted as JointlyPredicted
    from .assignment import Known as Known
    from .assignment import LearnedLatent as LearnedLatent
    from .assignment import LearnedPrior as LearnedPrior
    from .assignment import MeanShapeInitialiser as MeanShapeInitialiser
    from .assignment import Panel as Panel
    from .assignment import Predicted as Predicted
    from .assignment import PredictorFit as PredictorFit
    from .assignment import Rounds as Rounds
    from .assignment import Unassigned as Unassigned
    from .data import Collection as Collection
    from .domains import Domain as Domain
    from .domains import Images as Images
    from .domains import Maps as Maps
    from .domains import Volumes as Volumes
    from .networks import Generator as Generator
    from .projections.base import Identity as Identity
    from .projections.base import Projection as Projection
    from .projections.line_integral import LineIntegral as LineIntegral
    from .projections.observation import Observation as Observation
    from .projections.priors import Bins as Bins
    from .projections.priors import Cap as Cap
    from .projections.priors import Empirical as Empirical
    from .projections.priors import Mixture as Mixture
    from .projections.priors import Prior as Prior
    from .projections.priors import Product as Product
    from .projections.priors import Uniform as Uniform
    from .projections.rendering import Rendering as Rendering
    from .projections.selection import Selection as Selection
    from .projections.silhouette import Silhouette as Silhouette
    from .sharing import from_pretrained as from_pretrained
    from .sharing import push_to_hub as push_to_hub
    from .training import Adam as Adam
    from .training import Coarse as Coarse
    from .training import Options as Options
    from .training import Recipe as Recipe
    from .training import Run as Run
    from .training import Tries as Tries
    from .training import load as load
    from .training import resumable as resumable
    from .training import resume as resume
    from .training import train as train
