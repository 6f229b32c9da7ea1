"""Adversarial training: losses, gradient penalties, augmentation of images, regularisers of samples."""

from .adaptive import Adaptive
from .augmentation import Affine, Augmentation, AugmentationState, Shift, Sometimes
from .axisymmetric import Axisymmetric
from .inflated import Inflated
from .losses import Hinge, Logistic, Loss, Relativistic, Wasserstein
from .matching import Matching, MatchingState
from .penalties import R1R2, GradientPenalty, Penalty
from .regularisers import Centred, Connected, Rectilinear, Regulariser, Regularisers, Solid, Varied

__all__ = [
    "R1R2",
    "Adaptive",
    "Affine",
    "Augmentation",
    "AugmentationState",
    "Axisymmetric",
    "Centred",
    "Connected",
    "GradientPenalty",
    "Hinge",
    "Inflated",
    "Logistic",
    "Loss",
    "Matching",
    "MatchingState",
    "Penalty",
    "Rectilinear",
    "Regulariser",
    "Regularisers",
    "Relativistic",
    "Shift",
    "Solid",
    "Sometimes",
    "Varied",
    "Wasserstein",
]
