"""LearnedPrior: the distribution over views is learned by gradient together with the generator.

Images get no labels and one head scores all of them. A sample is projected in a view k drawn from p = softmax(l), and
the generator's loss trains l as well, through a straight-through Gumbel-softmax:

    u = softmax((l + g) / τ), g ~ Gumbel       k = argmax u
    y = P_k(x) + Σ_j (u_j - stop(u_j)) stop(P_j(x))

so that y equals the projection in view k while ∂y/∂u_j is the projection in view j. No view predictor is trained.

References:
    Zehni & Zhao 2021, UVTomo-GAN (an unknown view distribution learned adversarially).
    Jang, Gu & Poole 2017, Categorical reparameterization with Gumbel-softmax.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from .._types import UserError
from .context import Processes
from .panel import Assignment, AssignmentState, Panel
from .starting import views_at_start


@dataclass(frozen=True)
class LearnedPrior(Assignment):
    """One collection, one head, and a distribution over the views that is learned by gradient.

    Args:
        rate: Adam's learning rate of the logits l, β = (0.5, 0.99).
        temperature: τ. Low temperatures follow the draws closely and have noisy gradients.
        images: samples an update whose gradient reaches l; each is projected in every view for it. The loss is a mean
            over the batch, so that their part in it is images / batch.
        entropy_weight: factor of log K minus the entropy of p in the generator's loss: it keeps views probable that are
            seldom drawn while the generator is poor. Against the part of `images` it weighs batch / images times as
            much.

    Examples:
        >>> import unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> panel = up.Panel(views, up.data.observe(up.data.chairs(6, 16), views), up.LearnedPrior(rate=0.01))
        >>> panel.assignment.begin(panel, seed=0).log()
        {'views': [0.25, 0.25, 0.25, 0.25]}
    """

    rate: float = 5e-3
    temperature: float = 0.5
    images: int = 16
    entropy_weight: float = 0.02

    def __post_init__(self) -> None:
        if not (self.rate > 0 and self.temperature > 0 and self.images >= 1 and self.entropy_weight >= 0):
            raise UserError(f"{self}: give a positive rate and temperature, 1 image or more, entropy_weight 0 or more")

    def heads(self, panel: Panel) -> int:
        return 1

    def begin(self, panel: Panel, seed: int) -> LearnedPriorState:
        return LearnedPriorState(panel, *views_at_start(panel, seed, "LearnedPrior"), self)


class LearnedPriorState(AssignmentState):
    """p = softmax(l) over K views, uniform at the start; `views` is unused."""

    def __init__(self, panel: Panel, views: Tensor, heads: Tensor, settings: LearnedPrior) -> None:
        super().__init__(panel, views, heads)
        self.settings = settings
        self.logits = nn.Parameter(torch.zeros(len(panel.observations)))
        self.adam = torch.optim.Adam([self.logits], settings.rate, (0.5, 0.99))

    @property
    def shares(self) -> Tensor:
        """p, (K,)."""
        return self.logits.softmax(0)

    def relaxed(self, n: int, rng: torch.Generator) -> Tensor:
        """Draw u (n, K); the largest entry of a row is at k with probability p_k."""
        exponential = torch.empty(n, len(self.logits)).exponential_(generator=rng).clamp_min(1e-20)
        return ((self.logits - exponential.log().to(self.logits)) / self.settings.temperature).softmax(1)

    def project(self, x: Tensor, rows: Tensor, rng: torch.Generator) -> Tensor:
        u = self.relaxed(len(x), rng)
        if not torch.is_grad_enabled():
            return self.observe(x, u.argmax(1).cpu(), rng)
        return project_softly(lambda some, views: self.observe(some, views, rng), x, u, self.settings.images)

    def take_over(self, tensors: dict[str, Tensor]) -> bool:
        fits = "logits" in tensors and tensors["logits"].shape == self.logits.shape
        if fits:
            self.load_state_dict({"logits": tensors["logits"]}, strict=False)
        return fits

    def loss(self, fake: Tensor, rows: Tensor, progress: float) -> Tensor:
        """Return the weight times log K minus the entropy of p."""
        p = self.shares
        return self.settings.entropy_weight * (p * (p * len(p)).clamp_min(1e-12).log()).sum()

    def update(self, processes: Processes) -> None:
        processes.average_gradients(self)
        self.adam.step()
        self.adam.zero_grad()

    def optimisers(self) -> dict[str, torch.optim.Adam]:
        return {"adam": self.adam}

    def log(self) -> dict[str, Any]:
        return {"views": [round(share, 4) for share in self.shares.tolist()]}

    def view_shares(self, real: Tensor) -> Tensor:
        return self.shares.detach().cpu()

    def draw_views(self, n: int, rng: torch.Generator) -> Tensor:
        return torch.multinomial(self.shares.detach().cpu(), n, replacement=True, generator=rng)


def project_softly(project: Callable[[Tensor, Tensor], Tensor], x: Tensor, u: Tensor, images: int) -> Tensor:
    """Return each x_b projected in view argmax u_b; the first `images` carry the gradient of u.

    Args:
        project: (x, views) → projections, one view an element.
        u: (B, K), relaxed draws.
    """
    projected = project(x, u.argmax(1).cpu())
    few = u[:images]
    with torch.no_grad():
        others = torch.stack([project(x[:images], torch.full((len(few),), k)) for k in range(u.shape[1])])
    toward = torch.einsum("bk,kb...->b...", few - few.detach(), others)
    return torch.cat([projected[:images] + toward, projected[images:]])
