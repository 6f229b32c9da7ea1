"""Adversarial training: losses, gradient penalties, augmentation of images, regularisers of the generator."""

from .augmentation import Augmentation, Shift
from .losses import Hinge, Logistic, Loss, Relativistic, Wasserstein
from .penalties import R1R2, GradientPenalty, Penalty
from .regularisers import Solid

__all__ = [
    "Augmentation",
    "GradientPenalty",
    "Hinge",
    "Logistic",
    "Loss",
    "Penalty",
    "R1R2",
    "Relativistic",
    "Shift",
    "Solid",
    "Wasserstein",
]
