"""Start: a run that begins with the weights of another one instead of random ones, to learn from few images.

Generator, averaged generator and, where they fit, discriminators and what assignments have learned are taken over;
optimisers and counters begin anew, and there is one try only. The first checkpoint, of step 0, holds all that, so the
other run is not needed any more. A generator of twice the size grows from the other one's.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor, nn

from .._types import UserError
from . import checkpoint
from .counters import COUNTERS
from .description import describe
from .run_directory import read_recipe
from .state import State, stripped

OF_SAMPLES = ("hull", "truncation")
"""Settings of generators that only say how samples are drawn from the weights."""


@runtime_checkable
class Growing(Protocol):
    """A network that can take over the weights of one of half the size."""

    def grow(self, weights: dict[str, Tensor]) -> None:
        """Take them over. Raises UserError if they are of no such network."""


def start_from(state: State, path: Path) -> dict[str, Any]:
    """Take over the weights of the newest checkpoint of the run at `path`; return what recipe.json says of it.

    Raises:
        UserError: if `path` is no run, has no checkpoint, or its generator is of another architecture, or of another
            size than the same or the half.
    """
    stored = read_recipe(path)
    newest = checkpoint.newest(path / "checkpoints")
    tensors = checkpoint.load(newest)
    theirs, ours = stored["resolved"].get("generator"), json.loads(json.dumps(describe(state.recipe.generator)))
    networks = {"generator": state.generator, "average": state.average}
    growing = {part: network for part, network in networks.items() if isinstance(network, Growing)}
    if growing and is_half(theirs, ours):
        with _naming(path):
            for part, network in growing.items():
                network.grow(stripped(tensors, part))
    else:
        difference = differing_settings(theirs, ours)
        for part in networks:
            if not difference and (difference := differing_weights(stripped(tensors, part), state.generator)):
                difference += settings_of_one(theirs, ours)
        if difference:
            raise UserError(
                f"{path}: cannot start from it: {difference}; give the same settings, or train from new weights"
            )
        for part, network in networks.items():
            network.load_state_dict(stripped(tensors, part))
    state.counters.averaged = checkpoint.step_of(newest) + int(tensors.get(f"{COUNTERS}averaged", torch.zeros(())))
    if state.recipe.tries is not None:  # others would begin from new weights
        state.counters.tried = state.recipe.tries.count
    return {
        "run": str(path.absolute()),
        "step": checkpoint.step_of(newest),
        **{name: stored[name] for name in ("recipe", "arguments", "start")},
        "panels": [_take_over_panel(state, i, tensors) for i in range(len(state.panels))],
    }


def grow_from(state: State, path: Path) -> None:
    """Go on with the weights of the run at `path`, of half the size, with its steps, seconds and augmentations."""
    start_from(state, path)
    newest = checkpoint.newest(path / "checkpoints")
    counters, found = state.counters, checkpoint.counters_of(newest)
    counters.step, counters.seconds, counters.began = found.step, found.seconds, found.step
    for i, panel in enumerate(state.panels):
        theirs = stripped(checkpoint.load(newest, f"panels/{i}/augmentation/"), f"panels/{i}/augmentation")
        if panel.augmentation is not None and theirs:
            panel.augmentation.load_state_dict(theirs)
    state.go_on_from(0.0)


def _take_over_panel(state: State, index: int, tensors: dict[str, Tensor]) -> dict[str, Any]:
    """Take over what fits of a panel; say what did."""
    panel = state.panels[index]
    weights = stripped(tensors, "discriminators", f"{index}.")
    fits = _take_over(panel.discriminator, weights)
    found: dict[str, Any] = {"discriminator": fits}
    learned, theirs = panel.assignment.learned, stripped(tensors, f"panels/{index}/assignment", "learned.")
    if learned is not None and theirs and not differing_weights(theirs, learned):
        learned.load_state_dict(theirs)
        found["learned"] = [one.name for one in learned.settings]
    return found | {"views": panel.assignment.take_over(stripped(tensors, f"panels/{index}/assignment"))}


def _take_over(discriminator: nn.Module, weights: dict[str, Tensor]) -> bool:
    """Take over the weights of a discriminator, if they fit, or are of one that it grows from; say whether."""
    if not differing_weights(weights, discriminator):
        discriminator.load_state_dict(weights)
        return True
    with suppress(UserError):
        if isinstance(discriminator, Growing):
            discriminator.grow(weights)
            return True
    return False


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    try:
        yield
    except UserError as error:
        raise UserError(f"{path}: cannot start from it: {error}; or train from new weights") from error


def is_half(theirs: Any, ours: Any) -> bool:
    """Whether descriptions of generators are alike but for the size, of which theirs is half of ours."""
    given = theirs.get("arguments") if isinstance(theirs, dict) else None
    size, own = (part.get("size") if isinstance(part, dict) else None for part in (given, ours["arguments"]))
    if not isinstance(given, dict) or not isinstance(size, int) or 2 * size != own:
        return False
    return not differing_settings({**theirs, "arguments": {**given, "size": own}}, ours)


def differing_settings(theirs: Any, ours: Any) -> str:
    """Say which setting that both descriptions of a generator name differs; "" if none does."""
    if not isinstance(theirs, dict) or theirs.get("call") != ours.get("call"):
        there = theirs.get("call") if isinstance(theirs, dict) else "unknown"
        return f"its generator is {there}, and this recipe's {ours.get('call')}"
    given = theirs.get("arguments")
    given = given if isinstance(given, dict) else {}
    ours_given = {k: v for k, v in ours.get("arguments", {}).items() if k not in OF_SAMPLES}
    names = [name for name, value in ours_given.items() if name in given and given[name] != value]
    if not names:
        return ""
    there, here = (", ".join(f"{name}={part[name]}" for name in names) for part in (given, ours["arguments"]))
    return f"its generator has {there}, and this recipe's {here}"


def settings_of_one(theirs: Any, ours: Any) -> str:
    """Say which settings only one of both descriptions of a generator names; "" if none."""
    there, here = (found if isinstance(found := of.get("arguments"), dict) else {} for of in (theirs, ours))
    said = ""
    for words, given, other in (("that run has", there, here), ("this recipe has", here, there)):
        if names := [name for name in given if name not in other and name not in OF_SAMPLES]:
            said += f"; only {words} " + ", ".join(f"{name}={given[name]}" for name in names)
    return said


def differing_weights(theirs: dict[str, Tensor], module: nn.Module) -> str:
    """Say which weight is missing, of another shape or too many; "" if they fit the module."""
    there = {name: tuple(value.shape) for name, value in theirs.items()}
    here = {name: tuple(value.shape) for name, value in module.state_dict().items()}
    for name in sorted(there.keys() | here.keys()):
        if there.get(name) != here.get(name):
            return (
                f"weight {name} is {there.get(name, 'missing')} there, and {here.get(name, 'missing')} in this recipe"
            )
    return ""
