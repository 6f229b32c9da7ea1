"""Assignment: which observation made each image, and how generated samples are observed.

`Known`: the observation of each image is known (MP-GAN). `Predicted`: a view predictor estimates it (VP-MP-GAN).
`LearnedPrior`: only the distribution of views is learned (UVTomo-GAN). `Unassigned`: one discriminator for all views
(PrGAN). An assignment of your own derives from `Assignment`.
"""

from .context import Context
from .gaussian import GaussianInitialiser
from .learned_prior import LearnedPrior, LearnedPriorState
from .mean_shape import MeanShapeInitialiser
from .panel import Assignment, AssignmentState, Known, Panel, by_view, views_of
from .predicted import Initialiser, Predicted, PredictedState, Rounds
from .predictor import PredictorFit
from .responsibilities import Estimator
from .unassigned import Unassigned

__all__ = [
    "Assignment",
    "AssignmentState",
    "Context",
    "Estimator",
    "GaussianInitialiser",
    "Initialiser",
    "Known",
    "LearnedPrior",
    "LearnedPriorState",
    "MeanShapeInitialiser",
    "Panel",
    "Predicted",
    "PredictedState",
    "PredictorFit",
    "Rounds",
    "Unassigned",
    "by_view",
    "views_of",
]
