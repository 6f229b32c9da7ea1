"""JointlyPredicted: the view predictor is trained at every step, together with the generator, which it may steer.

Pictures of unknown view do not decide between the worlds that explain them: bodies of revolution, wide ones for wide
pictures, explain any set of mirror-symmetric silhouettes. What tells the true world is that its views can be predicted.
With q(k | y) the predictor, both minimise

    E[-log q(k | P_k(G(z), θ))]        the predictor with weight 1, the generator with weight w(progress)

and H(k) minus this cross entropy, H(k) the entropy of the views in use, is a lower bound of the mutual information I(k;
y) of views and pictures. A generator could make its projections more informative than pictures are, as one plate does
that differs from side to side where there are many boxes. So w falls while the bound exceeds the information of
pictures, H(mean q) - mean H(q), by more than a margin; and late in training w is negative beyond that, which penalises
information that pictures do not have. A q that is new to a world is overconfident of pictures, so that of theirs a
moving average over rounds counts, and tries are compared by what pictures hold less what projections hold beyond that.

References:
    Chen et al. 2016, InfoGAN (the bound, and its joint training).
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from torch import Tensor

from .._types import UserError
from ..data.sampling import spread_rows
from .context import Context, Processes
from .panel import Panel
from .predicted import Predicted, PredictedState
from .starting import views_at_start
from .view_findings import entropy, information

COMPLETE = 0.55
"""Share of log K from which on information counts as complete: objects that are their own mirror images hold 0.75."""
LEAST_BALANCE = 0.25
"""Share of the balance at complete information. Without any, shares of views that look alike drift apart."""
MEMORY, AVERAGED = 0.02, 0.05
"""Shares of the newest step in the moving averages of the cross entropy and of the predictor."""
COUNTED = 2**16
"""Images at most whose views are counted."""
NEWEST = 0.5
"""Share of the newest round in the moving average of the information of pictures."""


@dataclass(frozen=True)
class JointlyPredicted(Predicted):
    """Views by a predictor that is trained along with the generator; a round assigns the images anew, without a fit.

    Of `fit` the network, `mirrored` and `binarise` count.

    Args:
        weight: w, of the information in the generator's loss, at the start.
        fall: the parts of the budget between which a positive w falls, linearly, to 0, and a negative one rises
            to its full size. Once views are found, the pictures keep them.
        margin: nats by which the information of projections may exceed that of pictures; w falls over it, and over as
            much again to -weight.
        rate: Adam's learning rate of the predictor, β = (0.5, 0.999).

    Examples:
        >>> import unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> silhouettes = up.data.observe(up.data.chairs(6, 16), views)
        >>> panel = up.Panel(views, silhouettes, up.JointlyPredicted(weight=0.3))
        >>> sorted(panel.assignment.begin(panel, seed=0).log())
        ['view_information', 'view_information_of_data']
    """

    least_batch: ClassVar[int] = 2  # the predictor has batch statistics

    weight: float = 0.3
    fall: tuple[float, float] = (0.2, 0.6)
    margin: float = 0.5
    rate: float = 1e-3

    def __post_init__(self) -> None:
        if not (self.weight >= 0 and 0 <= self.fall[0] < self.fall[1] and self.margin > 0 and self.rate > 0):
            raise UserError(
                f"JointlyPredicted(weight={self.weight:g}, fall={self.fall}, margin={self.margin:g}, "
                f"rate={self.rate:g}): give a weight of 0 or more, 0 <= begin < end, a positive margin and rate"
            )
        if self.weight and self.fit.binarise:
            raise UserError(
                "JointlyPredicted: no gradient passes through binarise; give a weight of 0, or leave it out"
            )

    def begin(self, panel: Panel, seed: int) -> JointlyPredictedState:
        return JointlyPredictedState(panel, *views_at_start(panel, seed, "JointlyPredicted"), self, seed)


class JointlyPredictedState(PredictedState):
    """The predictor, its optimiser, and what it knows.

    Attributes:
        trained: the predictor that is trained at every step, on projections as discriminators see them: moved where
            there is an augmentation, as `of_fakes` is. `predictor`, which assigns images, is the moving average
            of its weights: what single steps make of real pictures differs by a third.
        of_fakes: moving average of H(k) minus the cross entropy of projections, nats.
        of_data: information of the real images, nats, moving average over rounds.
    """

    settings: JointlyPredicted
    of_fakes: Tensor
    of_data: Tensor

    def __init__(self, panel: Panel, views: Tensor, heads: Tensor, settings: JointlyPredicted, seed: int) -> None:
        super().__init__(panel, views, heads, settings, seed)
        self.trained = copy.deepcopy(self.predictor)
        self.predictor.requires_grad_(False)
        self.online = torch.optim.Adam(self.trained.parameters(), settings.rate, (0.5, 0.999), fused=True)
        for name in ("of_fakes", "of_data"):
            self.register_buffer(name, torch.tensor(0.0))

    def generator_weight(self, progress: float) -> float:
        """Return w(progress), less what the cap takes; late, negative beyond the cap."""
        begin, end = self.settings.fall
        falling = min(1.0, max(0.0, (end - progress) / (end - begin)))
        room = (float(self.of_data) + self.settings.margin - float(self.of_fakes)) / self.settings.margin
        return self.settings.weight * (falling * min(room, 1.0) if room > 0 else (1 - falling) * max(room, -1.0))

    def loss(self, fake: Tensor, rows: Tensor, progress: float) -> Tensor:
        """Return the cross entropy; its gradient reaches the generator times w, the predictor whole."""
        self.trained.train()
        w, views = self.generator_weight(progress), self._views_of_samples(rows).to(fake.device)
        images, views = self.settings.fit.half_mirrored(fake.detach() + w * (fake - fake.detach()), views)
        loss = F.cross_entropy(self.trained(self.settings.fit.prepared(images)), views)
        self.of_fakes.lerp_(self._view_entropy() - loss.detach().cpu(), MEMORY)
        return loss

    def _view_entropy(self) -> float:
        """Return H(k), nats, of the views in which samples are projected, and of those that mirror images stand for."""
        views, mirrored = self._views_of_samples(spread_rows(len(self.panel), COUNTED)), self.settings.fit.mirrored
        shares = torch.bincount(views, minlength=len(self.panel.observations)) / len(views)
        return entropy(shares if mirrored is None else (shares + shares[list(mirrored)]) / 2).item()

    def update(self, processes: Processes) -> None:
        processes.average_gradients(self.trained)
        self.of_fakes.copy_(processes.mean(self.of_fakes))  # else w would differ between processes
        self.online.step()
        self.online.zero_grad()
        with torch.no_grad():
            both = zip(self.predictor.state_dict().values(), self.trained.state_dict().values(), strict=True)
            means, news = map(list, zip(*(pair for pair in both if pair[0].is_floating_point())))
            torch._foreach_lerp_(means, news, AVERAGED)  # pyright: ignore[reportPrivateImportUsage]
            for name, count in self.predictor.named_buffers():
                if not count.is_floating_point():
                    count.copy_(self.trained.get_buffer(name))

    def take_over(self, tensors: dict[str, Tensor]) -> bool:
        fits = super().take_over(tensors)
        if fits:
            self.trained.load_state_dict(self.predictor.state_dict())
        return fits

    def _begin_round(self, due: int, run: Context) -> None:
        self.fitting.fill_(due)

    def _fit(self, run: Context, seed: int) -> float:
        return self._view_entropy() - float(self.of_fakes)

    def _responsibilities(self, p: Tensor) -> Tensor:
        """Return responsibilities balanced the less, the more of the views the pictures tell."""
        estimator = self.settings.estimator
        self.of_data.lerp_(torch.tensor(information(p)), NEWEST if self.round else 1.0)
        known = min(1.0, float(self.of_data) / (COMPLETE * math.log(p.shape[1])))
        balance = estimator.balance * max(LEAST_BALANCE, 1 - known)
        return replace(estimator, balance=balance).responsibilities(p)

    def merit(self) -> float:
        of_data = super().merit()
        return of_data - max(0.0, float(self.of_fakes) - of_data)

    def optimisers(self) -> dict[str, torch.optim.Adam]:
        return {"online": self.online}

    def log(self) -> dict[str, Any]:
        return {
            "view_information": round(float(self.of_fakes), 4),
            "view_information_of_data": round(float(self.of_data), 4),
        }
