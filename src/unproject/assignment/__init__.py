"""Assignment: which observation made each image, and how generated samples are observed.

`Known`: the observation of each image is known (MP-GAN). `Predicted`: a view predictor estimates it (VP-MP-GAN).
`JointlyPredicted`: the predictor is trained along with the generator, which prefers views that can be predicted.
`LearnedPrior`: only the distribution of views is learned (UVTomo-GAN). `Unassigned`: one discriminator for all views
(PrGAN). `LearnedLatent`: a latent of unknown distribution, such as elevation. An assignment of your own derives from
`Assignment`.
"""

from .context import Context, Processes
from .gaussian import GaussianInitialiser
from .jointly_predicted import JointlyPredicted, JointlyPredictedState
from .learned_latents import LearnedLatent, LearnedLatents
from .learned_prior import LearnedPrior, LearnedPriorState
from .mean_shape import MeanShapeInitialiser
from .panel import Assignment, AssignmentState, Known, Panel
from .predicted import Initialiser, Predicted, PredictedState, Rounds
from .predicting import PredictingSettings, PredictingState
from .predictor import PredictorFit
from .responsibilities import Estimator
from .unassigned import Unassigned
from .views import by_view, views_of

__all__ = [
    "Assignment",
    "AssignmentState",
    "Context",
    "Estimator",
    "GaussianInitialiser",
    "Initialiser",
    "JointlyPredicted",
    "JointlyPredictedState",
    "Known",
    "LearnedLatent",
    "LearnedLatents",
    "LearnedPrior",
    "LearnedPriorState",
    "MeanShapeInitialiser",
    "Panel",
    "Predicted",
    "PredictedState",
    "PredictingSettings",
    "PredictingState",
    "PredictorFit",
    "Processes",
    "Rounds",
    "Unassigned",
    "by_view",
    "views_of",
]
