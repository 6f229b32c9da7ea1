"""Fitter: finds the samples of a generator whose projections are given pictures.

For pictures y_1 … y_M of one object, of views θ_m that may be unknown,

    E(v, θ) = Σ_m |P(G(v), θ_m) - y_m|² / (D σ²) + λ |v|² / r

is minimised over whitened latents v (`LatentSpace`) and θ. D is the number of pixels, σ² the mean variance of a pixel
among projections of samples, so that λ means the same for silhouettes, photographs and lines.

1. Candidates: samples, each projected in every bin of views, or in the views that are known; the nearest few, with
   their views, are the starts.
2. Descent: Adam on v, for all starts together. θ is not followed by its gradient, since pictures of turned objects have
   many local minima: now and then views are drawn anew in every bin and near the present one, and the best are kept.
3. Weights: an explanation with energy E counts ((E_best / M + ε) / (E / M + ε))^(n M / 2), the likelihood with σ not
   known, if n pixels of a picture, as many as it is wide, are independent; ε = 0.02, as errors of interpolation decide
   nothing. The posterior of the bins of views comes from the same rule.
4. Linear readings whose views are known are kept: samples are completed to agree with them (`consistency`).

References:
    Xia et al. 2023, GAN inversion: a survey.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import torch
from torch import Tensor, nn

from .._random import generator_at
from .._types import UserError
from ..data.collection import as_floats
from ..networks import Generator
from .candidates import Candidates, each, rows
from .consistency import MAX_ENTRIES, Readings
from .fit import Fit
from .given import Pictures, check_pictures, warn_of_unit
from .search import Search
from .tuning import tuned
from .viewing import Latents, Viewing

VIEW_STEPS = (1.0, 1.0, 1.0, 1.0, 0.6, 0.6, 0.6, 0.3, 0.3, 0.3, 0.1, 0.1)
"""Views that are tried in a bin, one after another: draws, at this share of the way from the best so far."""
MIN_RELATIVE_WEIGHT = 0.02
"""Explanations with less of the best one's weight have no part in the posterior of views."""
DISTANCE_FLOOR = 0.02
"""Added to distances for weights: differences as small as those of interpolation decide nothing."""
Watch = Callable[[float, Tensor, Tensor], None]
"""(part that is done, best sample (1, ...), its projections (M, ...)): told of each step of the descent."""


@dataclass(frozen=True)
class State:
    """Starts on their way: whitened latents (S, r), bins (S, M) and latents of views by name (S, M)."""

    v: Tensor
    bins: Tensor
    theta: dict[str, Tensor]

    def __getitem__(self, which: Tensor) -> State:
        """Return some of the starts."""
        return State(self.v[which], self.bins[which], {name: value[which] for name, value in self.theta.items()})


@dataclass(frozen=True, eq=False)
class Fitter:
    """Finds samples of a generator by pictures; what is the same for all pictures is made once.

    Args:
        generator: in evaluation mode.
        viewing: how pictures come about.
        search: its settings.
        seed: of the candidates and of views.
        repeated: (x, times) → samples, each `times` in a row (`Domain.repeated`).
    """

    generator: Generator
    viewing: Viewing
    search: Search = Search()
    seed: int = 0
    repeated: Callable[[Tensor, int], Tensor] = field(default=lambda x, times: x.repeat_interleave(times, 0))

    @cached_property
    def candidates(self) -> Candidates:
        """The samples that pictures are compared with first."""
        return Candidates(self.generator, self.viewing, self.search.candidates, self.seed, self.repeated)

    def check(self, pictures: Tensor) -> None:
        """Raise UserError if there is no picture, one is not finite, or they are of another size than projections."""
        check_pictures(pictures, self.candidates.projections)

    def fit(
        self,
        pictures: Tensor | np.ndarray,
        known: Latents | None = None,
        watch: Watch = lambda *of: None,
        *,
        converted: bool = False,
    ) -> Fit:
        """Return explanations of pictures (M, ...) of one object.

        Args:
            pictures: a tensor or an array of floats, in the unit of projections (`Projection.from_measured` converts
                readings); or of bytes, which are scaled as `Collection` does.
            known: latents of the views that are known, by name, (M,) each; angles in radians.
            watch: told of each step; what it raises ends the fit.
            converted: pictures are known to be in the unit of projections: nothing is said of it.

        Warns:
            UserWarning: if pictures are over ten times as bright as projections of samples are, or known latents lie
                outside all that the run was trained on.

        Raises:
            UserError: if there is no picture, they are not of the size of the generator's projections, or what is known
                is no latent of these, or of another number; or something is not finite.
        """
        pictures = as_floats(pictures)
        self.check(pictures)
        if not converted:
            warn_of_unit(pictures, self.candidates.projections)
        of = Pictures.of(pictures, known or {}, self.viewing)
        rng = generator_at(self.seed, 0, "fit")
        with _without_gradient(self.generator):
            state = self._descended(self._starts(of, rng), of, rng, watch)
            return self._explained(state, of, rng)

    @torch.no_grad()
    def _starts(self, of: Pictures, rng: torch.Generator) -> State:
        """Return the nearest candidates, and for each the bins and views in which it is nearest."""
        candidates, count = self.candidates, self.search.candidates
        if of.known:
            bins = torch.multinomial(of.possible.float().repeat(count, 1), 1, generator=rng).view(count, -1)
            theta = rows(self.viewing.draw(bins.flatten(), each(of.known, count), rng), count)
            distance = candidates.distance(candidates.project(candidates.x, theta, len(of)), of.y)
        else:
            table = candidates.projections
            distance = torch.stack([candidates.distance(table, y.expand(table.shape[1:])) for y in of.y], 1)
            distance, bins = distance.min(2)
            theta = {name: value.gather(1, bins) for name, value in candidates.views.items()}
        best = distance.sum(1).topk(self.search.starts, largest=False).indices
        return State(candidates.latents, bins, theta)[best]

    def _descended(self, state: State, of: Pictures, rng: torch.Generator, watch: Watch) -> State:
        """Return the state after the descent, the starts in the order in which they were."""
        search, candidates = self.search, self.candidates
        v = state.v.clone().requires_grad_(True)
        adam = torch.optim.Adam([v], lr=search.rate, betas=(0.9, 0.99))
        searched = search.view_searches and not self.viewing.is_known(of.known)
        every = -(-search.steps // (search.view_searches + 1)) if searched else search.steps
        for step in range(search.steps):
            adam.param_groups[0]["lr"] = search.rate * (1 - 0.9 * step / search.steps)
            x = candidates.synthesise(v)
            if step and step % every == 0:
                state = self._better_viewed(state, x.detach(), of, rng)
            projected = candidates.project(x, state.theta, len(of))
            energy = self._energy(v, candidates.distance(projected, of.y))
            best = int(energy.argmin())
            watch(step / search.steps, x[best : best + 1].detach(), projected[best].detach())
            adam.zero_grad()
            energy.sum().backward()
            adam.step()
        return State(v.detach(), state.bins, state.theta)

    def _energy(self, v: Tensor, distance: Tensor) -> Tensor:
        """Return E (S,)."""
        return distance.sum(1) + self.search.prior * self.candidates.space.unusual(v)

    @torch.no_grad()
    def _better_viewed(self, state: State, x: Tensor, of: Pictures, rng: torch.Generator) -> State:
        """Return the state with better views, if there are such: one drawn in each bin, and some near the best."""
        theta, bins = state.theta, state.bins
        least = self.candidates.distance(self.candidates.project(x, theta, len(of)), of.y)
        everywhere = [torch.full_like(bins, k) for k in of.possible.any(0).nonzero()[:, 0].tolist()]
        steps = [(tried, 1.0) for tried in (everywhere if len(everywhere) > 1 else ())]
        for tried, by in (*steps, *((None, by) for by in VIEW_STEPS[::3])):
            tried = bins if tried is None else tried
            drawn, distance = self._tried(x, tried, of, rng, theta, by)
            better = distance < least
            least, bins = torch.where(better, distance, least), torch.where(better, tried, bins)
            theta = {name: torch.where(better, drawn[name], value) for name, value in theta.items()}
        return State(state.v, bins, theta)

    def _tried(
        self, x: Tensor, bins: Tensor, of: Pictures, rng: torch.Generator, near: Latents, by: float
    ) -> tuple[dict[str, Tensor], Tensor]:
        """Return views (S, M), drawn in these bins, then moved from `near` by this share of the way; and distances.

        They are infinite where a bin is not possible.
        """
        drawn = rows(self.viewing.draw(bins.flatten(), each(of.known, len(x)), rng), len(x))
        drawn = {name: value if by == 1 else torch.lerp(near[name], value, by) for name, value in drawn.items()}
        distance = self.candidates.distance(self.candidates.project(x, drawn, len(of)), of.y)
        return drawn, distance.masked_fill(~of.possible[torch.arange(len(of)), bins], torch.inf)

    def _explained(self, state: State, of: Pictures, rng: torch.Generator) -> Fit:
        """Return the explanations in order, their weights and the posterior of views."""
        candidates, n = self.candidates, of.y.shape[-1]
        with torch.no_grad():
            x = candidates.synthesise(state.v)
            energy = self._energy(state.v, candidates.distance(candidates.project(x, state.theta, len(of)), of.y))
        order = energy.argsort()[: int(energy.isfinite().sum())]  # what is not finite comes last
        if not len(order):
            rate = f"{self.search.rate:g}"
            raise UserError(f"fit: nothing that was found at a rate of {rate} is finite; give a lower --rate")
        state, x = state[order], x[order]
        with torch.no_grad():  # before one of them is tuned, which then would outweigh all others
            distance = candidates.distance(candidates.project(x, state.theta, len(of)), of.y)
            weight = _likelihood(self._energy(state.v, distance) / len(of), n * len(of), 0)
            heard = (weight >= MIN_RELATIVE_WEIGHT * weight.max()).nonzero()[:, 0]
            bins = self._posterior(x[heard], state[heard], distance[heard], of, rng)
            posterior = torch.einsum("s,smk->mk", weight[heard] / weight[heard].sum(), bins)
        if self.search.tune:
            x[:1] = self._tuned(x[:1], state[torch.tensor([0])], of)
        with torch.no_grad():
            projected = candidates.project(x, state.theta, len(of))
            distance = candidates.distance(projected, of.y)
            if consistent := self._is_linear(x, of):
                x = self._completed(x, of)
                projected = candidates.project(x, state.theta, len(of))
            x = self.generator.filled(x)
            return Fit(x, state.v, distance, weight, state.theta, posterior, projected, consistent)

    def _is_linear(self, x: Tensor, of: Pictures) -> bool:
        """Whether pictures are linear in samples, in views that are known, not too many, and noise can be told.

        Samples themselves, one map of a material and means of pixels have A Aᵀ ∝ 1: noise looks like all else there.
        """
        few = of.y.numel() * x[0].numel() <= MAX_ENTRIES
        linear = self.search.consistent and self.viewing.projection.linear and self.viewing.is_known(of.known)
        return linear and few and self._readings(_views(of), len(of), x.shape[1:]).tell_noise

    def _completed(self, x: Tensor, of: Pictures) -> Tensor:
        """Return samples (S, ...) that agree with the pictures, within [0, 1] if all candidates are."""
        readings = self._readings(_views(of), len(of), x.shape[1:])
        among = self.candidates.x.amin() >= 0 and self.candidates.x.amax() <= 1
        bounds = (0.0, 1.0) if among else (-math.inf, math.inf)
        completed = readings.completed(x.flatten(1).double(), of.y.flatten().double(), bounds)
        return completed.to(x).view_as(x)

    @cached_property
    def _readings(self) -> Callable[[tuple[tuple[str, tuple[float, ...]], ...], int, torch.Size], Readings]:
        """`_readings_of`, that keeps the last: sinograms of one folder mostly have the same angles."""
        return lru_cache(maxsize=1)(self._readings_of)

    def _readings_of(self, views: tuple[tuple[str, tuple[float, ...]], ...], count: int, shape: torch.Size) -> Readings:
        """Return the readings of so many pictures of these views, by name, of samples of this shape."""
        known = {name: torch.tensor(values) for name, values in views}

        def project(some: Tensor, which: Tensor) -> Tensor:
            return self.viewing.project(some, {name: value[which] for name, value in known.items()})

        return Readings.of(project, count, shape)

    def _tuned(self, x: Tensor, state: State, of: Pictures) -> Tensor:
        """Return the sample (1, ...) of a generator that was trained for the pictures, unless it is further off."""
        own = tuned(self.candidates, self.search, state.v, state.theta, of.y)
        with torch.no_grad():
            theta = {name: value.expand(2, -1) for name, value in state.theta.items()}
            projected = self.candidates.project(torch.cat([x, own]), theta, len(of))
            before, after = self.candidates.distance(projected, of.y).sum(1).tolist()
        return own if after <= before else x

    def _posterior(self, x: Tensor, state: State, found: Tensor, of: Pictures, rng: torch.Generator) -> Tensor:
        """Return (S, M, K), the probability of each bin for each explanation."""
        count = len(self.viewing.priors)
        least = found[..., None].masked_fill(torch.arange(count) != state.bins[..., None], torch.inf)
        for k in of.possible.any(0).nonzero()[:, 0].tolist() if count > 1 else ():
            bins = torch.full_like(state.bins, k)
            theta, best = self._tried(x, bins, of, rng, state.theta, 1.0)
            for by in VIEW_STEPS[1:]:
                drawn, distance = self._tried(x, bins, of, rng, theta, by)
                theta = {name: torch.where(distance < best, drawn[name], value) for name, value in theta.items()}
                best = torch.minimum(best, distance)
            least[..., k] = torch.minimum(least[..., k], best)
        return _likelihood(least, of.y.shape[-1], 2)


def _views(of: Pictures) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Return what is known of the views of pictures, as a key."""
    return tuple((name, tuple(value.tolist())) for name, value in of.known.items())


def _likelihood(distance: Tensor, readings: int, dim: int) -> Tensor:
    """Return e^(-readings / 2), the likelihood of a Gaussian whose variance is not known, as shares along `dim`."""
    return torch.softmax(-readings / 2 * (distance + DISTANCE_FLOOR).log(), dim)


@contextmanager
def _without_gradient(module: nn.Module) -> Iterator[None]:
    """Turn off the gradients of parameters, which would be computed and not used."""
    before = [p.requires_grad for p in module.parameters()]
    module.requires_grad_(False)
    try:
        yield
    finally:
        for p, needed in zip(module.parameters(), before, strict=True):
            p.requires_grad_(needed)
