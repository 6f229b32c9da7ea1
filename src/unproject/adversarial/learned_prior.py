"""LearnedPrior: how often each way of looking was taken, learned by gradient together with the generator.

Nobody says which way of looking made a real image, and nobody asks: one head judges all. A generated thing is looked
at in a way k drawn from p = softmax(l), and the generator's loss teaches l as well, through a straight-through
Gumbel-softmax:

    u = softmax((l + g) / τ), g ~ Gumbel       k = argmax u
    y = P_k(x) + Σ_j (u_j - stop(u_j)) stop(P_j(x))

so that y is the look k itself while ∂y/∂u_j is the look j. No view predictor has to be trained, and no image gets a
label; what is found is the distribution alone.

References:
    Zehni & Zhao 2021, UVTomo-GAN (an unknown view distribution learned adversarially).
    Jang, Gu & Poole 2017, Categorical reparameterization with Gumbel-softmax.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .._types import UserError


@dataclass(frozen=True)
class LearnedPrior:
    """One collection, one head, and a distribution over the ways of looking that is learned by gradient.

    Args:
        rate: Adam's learning rate of the logits l, β = (0.5, 0.99).
        temperature: τ. Low ones follow the draws closely and have noisy gradients.
        images: generated things an update whose gradient reaches l; each is looked at in every way for it.
        evenness: weight of log K minus the entropy of p in the generator's loss: keeps ways alive that are seldom
            drawn while the generator knows little.
    """

    rate: float = 5e-3
    temperature: float = 0.5
    images: int = 16
    evenness: float = 0.02

    def __post_init__(self) -> None:
        if not (self.rate > 0 and self.temperature > 0 and self.images >= 1 and self.evenness >= 0):
            raise UserError(f"{self}: give a positive rate and temperature, 1 image or more, evenness 0 or more")


class WayDistribution(nn.Module):
    """p = softmax(l) over K ways of looking, uniform at the start."""

    def __init__(self, ways: int) -> None:
        super().__init__()
        self.logits = nn.Parameter(torch.zeros(ways))

    @property
    def shares(self) -> Tensor:
        """p, (K,)."""
        return self.logits.softmax(0)

    def relaxed(self, n: int, temperature: float, rng: torch.Generator) -> Tensor:
        """u (n, K): softened draws; the largest of a row is at k with probability p_k."""
        exponential = torch.empty(n, len(self.logits)).exponential_(generator=rng).clamp_min(1e-20)
        return ((self.logits - exponential.log().to(self.logits)) / temperature).softmax(1)

    def unevenness(self) -> Tensor:
        """log K minus the entropy of p: 0 if all ways are as likely."""
        p = self.shares
        return (p * (p * len(p)).clamp_min(1e-12).log()).sum()


def look_softly(look: Callable[[Tensor, Tensor], Tensor], x: Tensor, u: Tensor, images: int) -> Tensor:
    """Each x_b seen in the way argmax u_b; the first `images` carry the gradient of u.

    Args:
        look: (x, ways) → what is seen, a way an element.
        u: (B, K), softened draws.
    """
    seen = look(x, u.argmax(1).cpu())
    few = u[:images]
    with torch.no_grad():
        others = torch.stack([look(x[:images], torch.full((len(few),), k)) for k in range(u.shape[1])])
    toward = torch.einsum("bk,kb...->b...", few - few.detach(), others)
    return torch.cat([seen[:images] + toward, seen[images:]])
