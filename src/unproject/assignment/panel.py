"""Panel: observations that share a discriminator, their data, and how images are assigned to observations.

An `Assignment` is a frozen setting; `begin(panel, seed)` makes its `AssignmentState`, which is part of the checkpoint.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from typing import Any, ClassVar, TypeAlias

import numpy as np
import torch
from torch import Tensor

from .._random import rows_of_all, shared_draws
from .._types import UserError
from ..data import Collection
from ..metrics import Finding, Score
from ..projections.base import Projection
from ..projections.observation import Observation, exact
from ..projections.priors import sample_each
from .assigned import Assigned, smallest
from .checks import check_panel
from .context import Context, Processes
from .learned_latents import LearnedLatent, LearnedLatents
from .views import views_of

Call: TypeAlias = Callable[..., Tensor]
CALL: Call = Projection.__call__


class Assignment(ABC):
    """How the images of a panel are assigned to its observations, and how generated samples are observed.

    Subclass it, as a frozen dataclass, for an assignment of your own: `begin` returns the state of a run.

    Attributes:
        projected_at_once: images that it projects at once between steps, for the estimate of memory.
        least_batch: images that a batch must have.

    Examples:
        >>> import torch, unproject as up
        >>> class AllFirst(up.Assignment):
        ...     def begin(self, panel, seed):
        ...         first = torch.zeros(len(panel), dtype=torch.long)
        ...         return up.AssignmentState(panel, first, first.clone())
        >>> itself, volumes = up.Observation("itself", up.Identity()), up.Collection(up.data.chairs(3, 16))
        >>> AllFirst().begin(up.Panel([itself], volumes), seed=0).views.tolist()
        [0, 0, 0]
    """

    projected_at_once: ClassVar[int] = 0
    least_batch: ClassVar[int] = 1

    def heads(self, panel: Panel) -> int:
        """Return how many heads the discriminator has (default: one an observation)."""
        return len(panel.observations)

    @abstractmethod
    def begin(self, panel: Panel, seed: int) -> AssignmentState:
        """Return the state at the start of a run.

        Raises:
            UserError: if the panel's data do not fit this assignment.
        """


@dataclass(frozen=True)
class Panel:
    """Observations with one projection and one discriminator (a head an observation), and the images they explain.

    Args:
        observations: they share one projection object and differ in their priors.
        data: one collection for all observations, or one for each.
        assignment: which observation made each image (default: `Known`).
        weight: factor of this panel's loss in the loss of the generator.
        penalty_scale: factor of the recipe's gradient penalty; above 1 where few images show many objects, which the
            discriminator would memorise.
        held_out: images of all observations that the discriminator never trains on, to measure its overfitting by
            (`Collection.split`; `Adaptive`).
        learned: latents whose distribution is learned along, the same for all observations. Priors need not draw those
            that the projection can do without.

    Raises:
        UserError: if a learned latent is none of the projection's, or named twice; if observations differ in their
            projections, or collections in the shape of their items or their number; for a weight that is not positive.

    Examples:
        >>> import unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> silhouettes = up.data.observe(up.data.chairs(6, 16), views, each=2)
        >>> panel = up.Panel(views, silhouettes, up.Predicted())
        >>> len(panel), panel.shape, panel.assignment.heads(panel)
        (12, (1, 16, 16), 4)
    """

    observations: Sequence[Observation]
    data: Collection | Sequence[Collection]
    assignment: Assignment = field(default_factory=lambda: Known())
    weight: float = 1.0
    penalty_scale: float = 1.0
    held_out: Collection | None = field(default=None, metadata={"described": "if given"})
    learned: tuple[LearnedLatent, ...] = field(default=(), metadata={"described": "if given"})

    def __post_init__(self) -> None:
        if isinstance(self.observations, Observation):
            raise UserError("panel: give a list of observations, [observation] if it has one")
        object.__setattr__(self, "observations", tuple(self.observations))
        if isinstance(self.data, Tensor | np.ndarray):
            raise UserError(f"panel: its data are a {type(self.data).__name__}; give up.Collection(data)")
        if not isinstance(self.data, Collection):
            object.__setattr__(self, "data", tuple(self.data))
        object.__setattr__(self, "learned", tuple(self.learned))
        weights = {"weight": self.weight, "penalty_scale": self.penalty_scale}
        check_panel(self.observations, self.collections, self.held_out, self.learned, weights)

    @property
    def projection(self) -> Projection:
        return self.observations[0].projection

    @property
    def collections(self) -> tuple[Collection, ...]:
        return (self.data,) if isinstance(self.data, Collection) else tuple(self.data)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of one image."""
        return self.collections[0].shape

    @cached_property
    def _ends(self) -> tuple[int, ...]:
        return tuple(accumulate(map(len, self.collections)))

    def __len__(self) -> int:
        """The number of images."""
        return self._ends[-1]

    def batch(self, rows: Tensor, device: torch.device | None = None) -> Tensor:
        """Return the images of these rows, (B, ...) float32; rows run through the collections one after another."""
        if len(self.collections) == 1:
            return self.collections[0].batch(rows, device)
        which = torch.bucketize(rows, torch.tensor(self._ends), right=True)
        images = torch.empty(len(rows), *self.shape, device=device)
        for k in which.unique().tolist():
            mine, begin = which == k, self._ends[k - 1] if k else 0
            images[mine.to(images.device)] = self.collections[k].batch(rows[mine] - begin, device)
        return images

    def project(
        self, x: Tensor, views: Tensor, rng: torch.Generator, learned: LearnedLatents | None = None, call: Call = CALL
    ) -> Tensor:
        """Return y_b = P(x_b, θ_b), θ_b ~ p_i with i = views[b], by one call of the shared projection.

        Args:
            views: (B,); or those of the whole batch, if `rng` is that of one process among several.
            learned: draws those latents whose distribution is learned, in place of the priors.
            call: calls the projection, its first argument; the trainer may have something faster.
        """
        source, count, own = shared_draws(rng, len(x))
        if len(views) != count:  # views of this process's part alone
            source, own = rng, slice(0, len(x))
        priors = [observation.prior for observation in self.observations]
        theta = sample_each(priors, views, source) if priors[0].names else {}
        theta |= learned.draw(len(views), source) if learned else {}
        return call(self.projection, x, **{name: exact(value[own], x) for name, value in theta.items()})


class AssignmentState(Assigned):
    """What is assigned during a run; its `state_dict` is part of the checkpoint.

    Attributes:
        views: (N,) the observation of each image.
        heads: (N,) the discriminator's head for each image.
        held_out_heads: (M,) the head for each image that is held out, if the panel has such; at first 0.
        learned: the latents whose distribution is learned, if the panel has such.
        fixes_gauge: whether views are known, so that samples come out in the frame of the data.

    Examples:
        >>> import torch, unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> panel = up.Panel(views, up.data.observe(up.data.chairs(6, 16), views))
        >>> state = panel.assignment.begin(panel, seed=0)
        >>> state.project(up.data.chairs(2, 16), rows=torch.tensor([3, 5]), rng=torch.Generator()).shape
        torch.Size([2, 1, 16, 16])
    """

    held_out_heads: Tensor
    fixes_gauge: bool = False

    def __init__(self, panel: Panel, views: Tensor, heads: Tensor) -> None:
        head_count = panel.assignment.heads(panel)
        super().__init__(views, heads, len(panel.observations), head_count)
        self.panel = panel
        if panel.held_out is not None:
            self.register_buffer("held_out_heads", torch.zeros(len(panel.held_out), dtype=smallest(head_count)))
        self.learned = LearnedLatents(panel.learned) if panel.learned else None
        self.call: Call = CALL

    def project(self, x: Tensor, rows: Tensor, rng: torch.Generator) -> Tensor:
        """Return projections of samples x (B, ...), each paired with the image of one of `rows` (B,)."""
        return self.observe(x, self.views[rows_of_all(rng, rows)].long(), rng)

    def observe(self, x: Tensor, views: Tensor, rng: torch.Generator) -> Tensor:
        """Return projections of x (B, ...) in `views` (B,), with what is learned of their latents."""
        return self.panel.project(x, views, rng, self.learned, self.call)

    def take_over(self, tensors: dict[str, Tensor]) -> bool:
        """Begin with what another run's state of this panel, its `state_dict`, has learned; return whether it fits."""
        return False

    def before_step(self, run: Context) -> bool:
        """Do what is due before a step; False if interrupted, and then called again to continue."""
        return True

    def loss(self, fake: Tensor, rows: Tensor, progress: float) -> Tensor | float:
        """Return a term of the generator's loss.

        Args:
            fake: (B, ...), projections of samples, paired with the images of `rows` (B,).
            progress: the part of the budget that is spent.
        """
        return 0.0

    def update(self, processes: Processes) -> None:
        """Update own parameters after the backward pass of the generator's loss."""

    def optimisers(self) -> dict[str, torch.optim.Adam]:
        """Return own optimisers by name; their moments are part of the checkpoint."""
        return {}

    def log(self) -> dict[str, Any]:
        """Return fields for the lines of the log."""
        return {}

    def merit(self) -> float:
        """Return how much is known of the views of images, to choose the best of several tries by."""
        return 0.0

    def estimates(self) -> Tensor | None:
        """Return (N,) the most probable view of each image, -1 of one not looked at; None if none is estimated.

        `views`, which samples are projected in, may be drawn instead.
        """
        return None

    def view_probabilities(self) -> Tensor | None:
        """Return p(k | y) (N + M, K) of the panel's images, then of those held out; None if views are not predicted."""
        return None

    def checks(self) -> dict[str, Score]:
        """Return scores of the assignment that need no known views."""
        return {}

    def findings(self, real: Tensor, generated: Tensor) -> list[Finding]:
        """Judge the assignment by real pictures (M, ...), held out if there are such, and projections (N, ...)."""
        return []

    def view_shares(self, real: Tensor) -> Tensor | None:
        """Return (K,) the share of pictures of each observation, estimated by `real` (M, ...); None if unknown."""
        return torch.bincount(self.views, minlength=len(self.panel.observations)) / len(self.views)

    def draw_views(self, n: int, rng: torch.Generator) -> Tensor:
        """Draw n views as frequent as those of the data."""
        return self.views[torch.randint(len(self.views), (n,), generator=rng)].long()


@dataclass(frozen=True)
class Known(Assignment):
    """The observation of each image is known: it is the one whose collection holds it (MP-GAN).

    With one collection for several observations, it is the first whose prior contains the image's known latents.

    Examples:
        >>> import unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> silhouettes = up.data.observe(up.data.chairs(6, 16), views)
        >>> panel = up.Panel(views, silhouettes, up.Known())
        >>> bool((panel.assignment.begin(panel, seed=0).views == silhouettes.latents["view"]).all())
        True
    """

    def begin(self, panel: Panel, seed: int) -> AssignmentState:
        if len(panel.collections) == 1 and len(panel.observations) > 1:
            views = views_of(panel.collections[0], panel.observations)
        else:
            counts = torch.tensor([len(collection) for collection in panel.collections])
            views = torch.arange(len(counts)).repeat_interleave(counts)
        state = AssignmentState(panel, views, views.clone())
        state.fixes_gauge = len(panel.observations) > 1
        if panel.held_out is not None and len(panel.observations) > 1:
            state.held_out_heads.copy_(views_of(panel.held_out, panel.observations))
        return state
