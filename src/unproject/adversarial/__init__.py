"""Adversarial training: losses, gradient penalties, augmentation of images, regularisers of samples."""

from .augmentation import Affine, Augmentation, Shift, Sometimes
from .losses import Hinge, Logistic, Loss, Relativistic, Wasserstein
from .penalties import R1R2, GradientPenalty, Penalty
from .regularisers import Solid

__all__ = [
    "R1R2",
    "Affine",
    "Augmentation",
    "GradientPenalty",
    "Hinge",
    "Logistic",
    "Loss",
    "Penalty",
    "Relativistic",
    "Shift",
    "Solid",
    "Sometimes",
    "Wasserstein",
]
