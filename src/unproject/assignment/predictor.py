"""Fitting a view predictor, by cross entropy, to projections of generated samples whose views are known."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._random import generator_at, seed_globally, seeded
from .._types import UserError
from ..networks import ViewPredictor

CHUNK, VIEWS_PER_SAMPLE = 256, 4


@dataclass(frozen=True)
class PredictorFit:
    """The view predictor and how it is fitted: Adam (0.5, 0.999), a learning rate that falls linearly to zero.

    Args:
        network: (image shape, number of views) → view predictor.
        images: projections of generated samples that it is fitted to.
        steps, batch, learning_rate: of the fit.
        binarise: threshold images at ½ before the predictor sees them.
        fresh: start from new weights in every round instead of the last round's.
        mirrored: the view of which the flipped image is as likely as the image is of each view: for silhouettes of
            objects that are their own mirror images (`projections.mirrored_views`), for line integrals of any
            (`opposite_directions`). Half of the images are flipped in the fit, and probabilities are means over an
            image and its flip (default: none are flipped).

    Examples:
        >>> import torch, unproject as up
        >>> images, views = torch.rand(8, 1, 16, 16), torch.arange(8) % 4
        >>> fit = up.PredictorFit(steps=2, batch=4)
        >>> predictor = fit.network((1, 16, 16), 4)
        >>> loss = fit.fitted(predictor, images, views, seed=0)
        >>> fit.probabilities(predictor, [images]).shape
        torch.Size([8, 4])
    """

    network: Callable[[tuple[int, ...], int], nn.Module] = ViewPredictor
    images: int = 2048
    steps: int = 150
    batch: int = 128
    learning_rate: float = 2e-3
    binarise: bool = False
    fresh: bool = False
    mirrored: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        for name in ("images", "steps", "batch"):
            if getattr(self, name) < 1:
                raise UserError(f"PredictorFit({name}={getattr(self, name)}): must be at least 1")
        if not 0 < self.learning_rate < math.inf:
            raise UserError(f"PredictorFit(learning_rate={self.learning_rate}): give a positive rate")

    def optimiser(self, predictor: nn.Module) -> torch.optim.Adam:
        return torch.optim.Adam(predictor.parameters(), self.learning_rate, (0.5, 0.999))

    def prepared(self, images: Tensor) -> Tensor:
        """Return the images as the predictor sees them."""
        return (images > 0.5).to(images) if self.binarise else images

    def half_mirrored(self, images: Tensor, views: Tensor) -> tuple[Tensor, Tensor]:
        """Return images and views of which the second half is flipped, if there are `mirrored` views."""
        if self.mirrored is None:
            return images, views
        half, mirrored = len(images) // 2, torch.tensor(self.mirrored, device=views.device)
        flipped = torch.cat([images[:half], images[half:].flip(-1)])
        return flipped, torch.cat([views[:half], mirrored[views[half:]]])

    def run(
        self,
        predictor: nn.Module,
        optimiser: torch.optim.Adam,
        images: Tensor,
        views: Tensor,
        seed: int,
        done: int = 0,
    ) -> Iterator[tuple[int, Tensor]]:
        """Fit `predictor` to images (N, ...) of known views (N,), one step for each item that is taken.

        An interrupted fit continues from the same weights, the same optimiser and the number of steps `done`. Yields
        (steps done, loss); at the end the predictor is in evaluation mode. Each step seeds torch's global sources, for
        layers that draw.
        """
        predictor.train()
        images = self.prepared(images)
        for step in range(done, self.steps):
            seed_globally(seed, step, "layers of the view predictor")
            rows = torch.randint(len(images), (self.batch,), generator=generator_at(seed, step, "view predictor"))
            optimiser.param_groups[0]["lr"] = self.learning_rate * (1 - step / self.steps)
            some, labels = self.half_mirrored(images[rows], views[rows].to(images.device))
            loss = F.cross_entropy(predictor(some), labels)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            yield step + 1, loss.detach()
        predictor.eval()

    def fitted(self, predictor: nn.Module, images: Tensor, views: Tensor, seed: int) -> float:
        """Fit `predictor` from beginning to end; return the last loss."""
        with seeded(seed, "view predictor"):  # which gives the global source back
            steps = self.run(predictor, self.optimiser(predictor), images, views, seed)
            _, loss = deque(steps, maxlen=1)[0]
        return loss.item()

    @torch.no_grad()
    def probabilities(self, predictor: nn.Module, batches: Iterable[Tensor]) -> Tensor:
        """Return the probability of every view for each image, (N, K), on the CPU."""
        predictor.eval()  # one that was just loaded is in training mode
        device = next(predictor.parameters()).device
        return torch.cat([self._of_batch(predictor, self.prepared(part).to(device)).cpu() for part in batches])

    def _of_batch(self, predictor: nn.Module, images: Tensor) -> Tensor:
        p = predictor(images).softmax(1)
        if self.mirrored is None:
            return p
        return (p + predictor(images.flip(-1)).softmax(1)[:, list(self.mirrored)]) / 2
