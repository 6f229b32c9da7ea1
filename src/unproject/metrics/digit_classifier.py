"""Features of digits from two small classifiers, trained by `tools/train_digit_classifier.py`.

One knows upright digits, the other digits turned by any angle and mirrored, at random. Their weights are part of the
package, so nothing is downloaded; the files' metadata names the training data and the accuracy on held-out images.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files

import torch
import torch.nn.functional as F
from safetensors import safe_open
from torch import Tensor, nn

from .._types import UserError

SIDE, FEATURES, CLASSES = 32, 64, 10
SURE, MOSTLY = 0.9, 0.5
"""A probability of a class, and the share of images that have one so large, of digits: 0.94 of MNIST, 0.90 of the
embedded ones; of silhouettes of birds, phantoms and noise 0.03 to 0.10."""
BATCH = 500
UPRIGHT, TURNED = "digit_classifier", "turned_digit_classifier"


class DigitClassifier(nn.Module):
    """Three 3² convolutions of 16, 32 and 64 channels, each halving the side, 64 features, ten classes."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for before, after in ((1, 16), (16, 32), (32, 64)):
            layers += [nn.Conv2d(before, after, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2)]
        self.body = nn.Sequential(*layers, nn.Flatten(), nn.Linear(64 * (SIDE // 8) ** 2, FEATURES))
        self.head = nn.Linear(FEATURES, CLASSES)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Return features (B, 64) and logits (B, 10) of images (B, 1, 32, 32) in [0, 1]."""
        features = self.body(images)
        return features, self.head(F.relu(features))


@cache
def digit_classifier(name: str = UPRIGHT) -> DigitClassifier:
    """Load a classifier with the weights of the package, in evaluation mode."""
    classifier = DigitClassifier()
    with (
        as_file(files("unproject.metrics") / f"{name}.safetensors") as path,
        safe_open(path, "pt") as stored,  # pyright: ignore[reportGeneralTypeIssues]
    ):
        classifier.load_state_dict({name: stored.get_tensor(name).float() for name in stored.keys()})  # noqa: SIM118
    return classifier.eval().requires_grad_(False)


@torch.no_grad()
def are_digits(images: Tensor) -> bool:
    """Whether most of these images (N, 1, H, W) are surely one of the ten digits, white on black.

    Examples:
        >>> import torch, unproject as up
        >>> are_digits(up.data.digits(32)[:64]), are_digits(torch.rand(64, 1, 32, 32))
        (True, False)
    """
    sure = [digit_classifier()(part)[1].softmax(1).amax(1) > SURE for part in _prepared(images).split(BATCH)]
    return torch.cat(sure).float().mean().item() > MOSTLY


@torch.no_grad()
def digit_features(images: Tensor, name: str = UPRIGHT) -> tuple[Tensor, Tensor]:
    """Return features (N, 64) and classes 0 to 9 (N,) of white digits on black, (N, 1, H, W) in [0, 1].

    The classifier `name` is UPRIGHT, or TURNED, for digits at any turn, mirrored or not.

    Images of other sizes than 32² are resampled.

    Raises:
        UserError: for other shapes, no image, or values that are not finite.

    Examples:
        >>> import torch
        >>> features, classes = digit_features(torch.rand(3, 1, 28, 28))
        >>> features.shape, classes.shape
        (torch.Size([3, 64]), torch.Size([3]))
    """
    found = [digit_classifier(name)(part) for part in _prepared(images).split(BATCH)]
    return torch.cat([features for features, _ in found]), torch.cat([logits for _, logits in found]).argmax(1)


def _prepared(images: Tensor) -> Tensor:
    """Return images as the classifiers take them, (N, 1, 32, 32)."""
    if images.dim() != 4 or images.shape[1] != 1 or not images.numel():
        raise UserError(f"digit features: give images (N, 1, H, W), not {tuple(images.shape)}")
    if not bool(torch.isfinite(images).all()):
        raise UserError("digit features: the images have NaN or infinite values; fix or leave out those images")
    images = images.float()
    if images.shape[2:] == (SIDE, SIDE):
        return images
    return F.interpolate(images, size=(SIDE, SIDE), mode="bilinear", align_corners=False, antialias=True)
