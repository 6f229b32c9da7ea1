"""Adversarial training: losses, gradient penalties, augmentation of images, regularisers of samples."""

from .augmentation import Augmentation, Shift
from .losses import Hinge, Logistic, Loss, Relativistic, Wasserstein
from .penalties import R1R2, GradientPenalty, Penalty
from .regularisers import Connected, Inside, Regulariser, Regularisers, Solid

__all__ = [
    "R1R2",
    "Augmentation",
    "Connected",
    "GradientPenalty",
    "Hinge",
    "Logistic",
    "Loss",
    "Penalty",
    "Inside",
    "Regulariser",
    "Regularisers",
    "Relativistic",
    "Shift",
    "Solid",
    "Wasserstein",
]
