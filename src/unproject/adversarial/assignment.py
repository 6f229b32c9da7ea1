"""Assignment: which way of looking made each real image?

`Known`: each image comes with it (MP-GAN). `Predicted`: nobody knows; a view predictor trained on the
generator's own labelled projections says so, and everything is trained in alternation (VP-MP-GAN).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._random import generator_at
from .._types import UserError
from ..projections.observation import Observation

DRAWS = ("argmax", "posterior")

FirstGuess = Callable[[Sequence[Observation], Tensor, int], Tensor]


@dataclass(frozen=True)
class Known:
    """Image n was made by the look whose collection it is in, and that look's head judges it."""


@dataclass(frozen=True)
class Predicted:
    """Rounds of: train the generator, train a view predictor on its projections, assign the real images.

    Round 0 gives every image a uniformly random way of looking and one head (PrGAN with discrete views), or what a
    first guess says of it and a head a way.
    At the start of every later round the predictor is trained on projections of generated things at uniform
    views; each real image takes the most probable way of looking (`draw="argmax"`) or one drawn from the
    predicted probabilities (`draw="posterior"`). A generated thing is looked at in the way of the real image
    it is paired with, so the view distribution is the predicted one.

    Args:
        starts: the part of the budget at which each later round starts, increasing within (0, 1).
        predictor: (image shape, number of ways) → view predictor.
        images: projections of generated things that each round's predictor is trained on.
        steps, batch, learning_rate: of the predictor, whose weights go on from round to round.
        clusters: judge with this many heads, from k-means of the predicted probabilities, in place of one
            head a way of looking.
        restart: train the generator and the discriminator of round 1 from scratch, as the released code does.
        binarise: threshold images at ½ before the predictor sees them.
        fresh: train the predictor from scratch in every round.
        balance: how far the estimated view distribution is drawn to the uniform one, 0 (not) to 1 (`balanced`).
        window: the ways go around in order, and the images were made in this many neighbouring ones, nobody knows
            which: each round takes the run of ways that makes the collection likeliest, and no other.
        first: (ways of looking, images (N, ...), seed) → probabilities (N, ways) for round 0.

    References:
        Li et al. 2019; schedule and clusters from the authors' released implementation.
    """

    predictor: Callable[[tuple[int, ...], int], nn.Module]
    starts: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8)
    images: int = 2048
    steps: int = 150
    batch: int = 128
    learning_rate: float = 2e-3
    draw: Literal["argmax", "posterior"] = "argmax"
    clusters: int | None = None
    restart: bool = False
    binarise: bool = False
    fresh: bool = False
    balance: float = 0.0
    window: int | None = None
    first: FirstGuess | None = None

    def __post_init__(self) -> None:
        if list(self.starts) != sorted(set(self.starts)) or not all(0 < s < 1 for s in self.starts):
            raise UserError(f"Predicted(starts={self.starts}): give increasing parts of the budget between 0 and 1")
        if self.draw not in DRAWS:
            raise UserError(f"Predicted(draw={self.draw!r}): choose one of {', '.join(DRAWS)}")
        for name in ("images", "steps", "batch"):
            if getattr(self, name) < 1:
                raise UserError(f"Predicted({name}={getattr(self, name)}): must be at least 1")
        if self.window is not None and self.window < 1:
            raise UserError(f"Predicted(window={self.window}): must be at least 1, or None for all ways")
        if self.clusters is not None and self.clusters < 1:
            raise UserError(f"Predicted(clusters={self.clusters}): must be at least 1, or None for a head a way")


def uniform_ways(images: int, ways: int, seed: int) -> Tensor:
    """A uniformly random way of looking for every image, (images,)."""
    return torch.randint(ways, (images,), generator=generator_at(seed, 0, "uniform ways"))


def train_predictor(predictor: nn.Module, images: Tensor, ways: Tensor, settings: Predicted, seed: int) -> float:
    """Fit `predictor` to images (N, C, H, W) of known ways (N,) as `fit` does; returns the last loss."""
    steps = fit(predictor, predictor_optimiser(predictor, settings), images, ways, settings, seed)
    _, loss = deque(steps, maxlen=1)[0]
    return loss.item()


def predictor_optimiser(predictor: nn.Module, settings: Predicted) -> torch.optim.Adam:
    return torch.optim.Adam(predictor.parameters(), settings.learning_rate, (0.5, 0.999))


def fit(
    predictor: nn.Module,
    optimiser: torch.optim.Adam,
    images: Tensor,
    ways: Tensor,
    settings: Predicted,
    seed: int,
    done: int = 0,
) -> Iterator[tuple[int, Tensor]]:
    """Fit `predictor` to images (N, C, H, W) of known ways (N,) by cross entropy, a step each time it is asked.

    Adam (0.5, 0.999), learning rate falling linearly to zero. Left after any step, it is gone on with by the same
    weights, the same optimiser and the steps `done`. Yields (steps done, loss); in the end the predictor is in
    evaluation mode.
    """
    predictor.train()
    images = (images > 0.5).to(images) if settings.binarise else images
    for step in range(done, settings.steps):
        rows = torch.randint(len(images), (settings.batch,), generator=generator_at(seed, step, "view predictor"))
        optimiser.param_groups[0]["lr"] = settings.learning_rate * (1 - step / settings.steps)
        loss = F.cross_entropy(predictor(images[rows]), ways[rows].to(images.device))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        yield step + 1, loss.detach()
    predictor.eval()


@torch.no_grad()
def predict(predictor: nn.Module, images: Tensor, binarise: bool = False, batch: int = 512) -> Tensor:
    """The probability of every way of looking for each image, (N, ways), on the CPU."""
    images = (images > 0.5).to(images) if binarise else images
    device = next(predictor.parameters()).device
    return torch.cat([predictor(part.to(device)).softmax(1).cpu() for part in images.split(batch)])


def balanced(probabilities: Tensor, balance: float, iterations: int = 50) -> Tensor:
    """Rescale the columns of (N, ways) so that their means m become t ∝ m^(1 - balance); rows still sum to 1.

    Sinkhorn's iteration. Left to itself the estimate runs away: views that are predicted often are generated
    often, and then predicted more often still.
    """
    target = probabilities.mean(0).clamp_min(1e-6) ** (1 - balance)
    target = target / target.sum()
    for _ in range(iterations):
        probabilities = probabilities * (target / probabilities.mean(0).clamp_min(1e-12))
        probabilities = probabilities / probabilities.sum(1, keepdim=True)
    return probabilities


def likeliest_run(probabilities: Tensor, length: int) -> Tensor:
    """The `length` neighbouring ways, (length,), around a circle, that make all images likeliest:

    argmax over runs R of Σ_n log Σ_{k in R} p(k | y_n).
    """
    ways = probabilities.shape[1]
    runs = (torch.arange(ways)[:, None] + torch.arange(min(length, ways))) % ways
    likelihood = [probabilities[:, run].sum(1).clamp_min(1e-9).log().mean() for run in runs]
    return runs[int(torch.stack(likelihood).argmax())]


def estimated(probabilities: Tensor, settings: Predicted) -> Tensor:
    """What a round believes of each image, (N, ways): within the likeliest run, balanced."""
    count = probabilities.shape[1]
    run = torch.arange(count) if settings.window is None else likeliest_run(probabilities, settings.window)
    inside = probabilities[:, run].clamp_min(1e-12)
    inside = inside / inside.sum(1, keepdim=True)
    if settings.balance:
        inside = balanced(inside, settings.balance)
    return torch.zeros_like(probabilities).index_copy(1, run, inside)


def choose_ways(probabilities: Tensor, draw: str, rng: torch.Generator) -> Tensor:
    """One way of looking for each row of (N, ways): the most probable, or a draw from the row."""
    if draw == "argmax":
        return probabilities.argmax(1)
    return torch.multinomial(probabilities, 1, generator=rng)[:, 0]


def k_means(rows: Tensor, clusters: int, rng: torch.Generator, starts: int = 5) -> Tensor:
    """The cluster of each row: the best of several runs of Lloyd's algorithm from k-means++ seeds."""
    runs = [_lloyd(rows, _spread_seeds(rows, clusters, rng)) for _ in range(starts)]
    return min(runs, key=lambda run: run[0])[1]


def _spread_seeds(rows: Tensor, clusters: int, rng: torch.Generator) -> Tensor:
    """k-means++: each further centre is a row drawn in proportion to its squared distance to the nearest one."""
    centres = rows[torch.randint(len(rows), (1,), generator=rng)]
    while len(centres) < clusters:
        nearest = torch.cdist(rows, centres).min(1).values.square() + 1e-12
        centres = torch.cat([centres, rows[torch.multinomial(nearest, 1, generator=rng)]])
    return centres


def _lloyd(rows: Tensor, centres: Tensor, iterations: int = 50) -> tuple[float, Tensor]:
    """(sum of squared distances, cluster of each row); an empty cluster keeps its centre."""
    distance, cluster = torch.cdist(rows, centres).min(1)
    for _ in range(iterations):
        for c in cluster.unique().tolist():
            centres[c] = rows[cluster == c].mean(0)
        distance, moved = torch.cdist(rows, centres).min(1)
        if torch.equal(moved, cluster):
            break
        cluster = moved
    return float(distance.square().sum()), cluster
