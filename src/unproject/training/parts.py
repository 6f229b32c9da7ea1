"""Whether the parts of a recipe fit one another: one small pass through all of them before anything is written.

Operators, generators, discriminators and losses may be a user's own; what does not fit would fail deep inside the first
step, or train on something else without a word, as logits of the wrong shape do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn

from .._random import generator_at, seeded
from .._types import UserError, is_lack_of_memory
from ..assignment import Panel
from .recipe import Recipe
from .state import PanelState, State

SAMPLES = 2
LOOKED_AT = 16
"""Observations of a panel, of which there may be thousands, whose priors are tried."""
"""Samples that are passed through."""


def check_parts(recipe: Recipe, state: State) -> None:
    """Generate samples, project and judge them, in every panel; buffers and global random numbers stay as they are.

    Raises:
        UserError: naming the part that fails or whose result has another shape than the next one takes.
    """
    with _unchanged((state.generator, *state.discriminators)), seeded(recipe.seed, "parts"), torch.no_grad():
        code = state.generator.draw(SAMPLES, generator_at(recipe.seed, 0, "parts")).to(state.device)
        with _called(f"the generator {_name(state.generator)}", "generator(codes (B, L)) and returns samples (B, ...)"):
            x = state.generator(code).float()
        if recipe.regulariser is not None:
            name = f"the regulariser {_name(recipe.regulariser)}"
            with _called(name, "regulariser(x, progress) and returns a number"):
                _check_number(name, recipe.regulariser(x, 0.0))
        with _called(f"the domain {_name(state.domain)}", "domain.preview(x (N, ...)) and returns a picture"):
            state.domain.preview(x.cpu())
        for panel in state.panels:
            _check_drawn(panel)
            _check_judged(recipe, panel, _projected(panel, x))


def _check_drawn(state: PanelState) -> None:
    """Check that priors draw one number for each latent of an item."""
    for observation in state.panel.observations[:LOOKED_AT]:
        with _called(f"the prior of {observation.name}", "prior.sample(n, rng) and returns name -> (n,)"):
            drawn = observation.prior.sample(SAMPLES, generator_at(0, 0, "parts"))
        for name, value in drawn.items():
            if tuple(value.shape) != (SAMPLES,):
                raise UserError(
                    f"the prior of {observation.name} draws {name!r} of shape {tuple(value.shape)} for {SAMPLES} "
                    "items; a latent is one number an item: draw the row of a table, and let the projection look it up"
                )


def _projected(state: PanelState, x: Tensor) -> Tensor:
    """Return projections of samples, of the shape of the panel's data."""
    panel = state.panel
    name = f"the projection of panel {_names(panel)}"
    with _called(name, f"projection(x {tuple(x.shape)}, **latents (B,)) and returns images (B, ...)"):
        views, rng = torch.zeros(len(x), dtype=torch.long), generator_at(0, 0, "parts")
        y = panel.project(x, views, rng, state.assignment.learned)
    if tuple(y.shape) != (len(x), *panel.shape):
        raise UserError(
            f"{name} makes {tuple(y.shape[1:])} of the generator's samples {tuple(x.shape[1:])}, and the data are "
            f"{panel.shape}; give data, a projection and a generator that fit"
        )
    return y


def _check_judged(recipe: Recipe, state: PanelState, y: Tensor) -> None:
    heads = torch.zeros(len(y), dtype=torch.long, device=y.device)
    name = f"the discriminator {_name(state.discriminator)} of panel {_names(state.panel)}"
    with _called(name, "discriminator(y (B, ...), head (B,)) and returns logits (B,), of each image that of its head"):
        logits = state.discriminator(y, heads)
    if tuple(logits.shape) != (len(y),):
        raise UserError(
            f"{name} returns {tuple(logits.shape)} for {len(y)} images; it is called as discriminator(y, head) and "
            "returns logits (B,), of each image that of its head"
        )
    for kind in ("discriminator", "generator"):
        name = f"the {kind}'s loss of {_name(recipe.loss)}"
        with _called(name, f"loss.{kind}(real (B,), fake (B,)) and returns a number"):
            _check_number(name, getattr(recipe.loss, kind)(logits.float(), logits.float()))


def _check_number(name: str, value: Tensor | float) -> None:
    if isinstance(value, Tensor) and value.dim():
        raise UserError(f"{name} returns {tuple(value.shape)}; it is to be one number, such as a mean")


@contextmanager
def _called(name: str, how: str) -> Iterator[None]:
    """Say of what fails how it is called."""
    try:
        yield
    except Exception as error:
        if isinstance(error, UserError) or is_lack_of_memory(error):
            raise
        first = str(error).partition("\n")[0]
        raise UserError(f"{name} fails ({type(error).__name__}: {first}); it is called as {how}") from error


@contextmanager
def _unchanged(modules: Iterable[nn.Module]) -> Iterator[None]:
    """Give modules the buffers back that they had: statistics of batches, vectors of spectral norms."""
    inner = [one for module in modules for one in module.modules()]
    before = [(one, name, b, b.clone()) for one in inner for name, b in one._buffers.items() if b is not None]
    try:
        yield
    finally:
        for one, name, buffer, value in before:
            one._buffers[name] = buffer.copy_(value)


def _names(panel: Panel) -> str:
    return ", ".join(repr(observation.name) for observation in panel.observations[:3])


def _name(part: object) -> str:
    return type(part).__name__
