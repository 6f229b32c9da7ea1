"""What a run knows of pictures that are to be fitted: how they came about, and of which kind they are."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from .._random import generator_at
from .._types import UserError
from ..assignment import AssignmentState
from ..inversion import Novelty, Viewing
from ..projections.base import Identity

COMPARED = 4096
"""Training pictures that others are compared with, at most."""


def state_of(states: Sequence[AssignmentState], observation: str | None) -> AssignmentState:
    """Return the panel that has this observation; without a name, the only panel there is.

    Raises:
        UserError: if there is no such observation, or there are several panels and no name is given.
    """
    states = of_different_kinds(states)
    names = [o.name for state in states for o in state.panel.observations]
    if observation is None and len(states) > 1:
        raise UserError(f"the run has several kinds of pictures; say which this is, one of {', '.join(names)}")
    if observation is not None and observation not in names:
        raise UserError(f"the run has no observation {observation!r}; it has {', '.join(names)}")
    return next(s for s in states if observation is None or observation in [o.name for o in s.panel.observations])


def of_different_kinds(states: Sequence[AssignmentState]) -> list[AssignmentState]:
    """Return the panels but for those whose observations another one has: of pictures whose views are known too."""
    kinds = [(state.panel.projection, {o.name for o in state.panel.observations}) for state in states]
    return [states[row] for row in different_kinds(kinds)]


def different_kinds(kinds: Sequence[tuple[object, set[str]]]) -> list[int]:
    """Return the rows of kinds, (projection, names of observations), but for those that another one contains."""

    def contains(i: int, j: int) -> bool:
        """Whether kind i has the observations of j, and more, or the same and comes first."""
        (projection, mine), (other, theirs) = kinds[i], kinds[j]
        return projection == other and (theirs < mine or (theirs == mine and i < j))

    rows = range(len(kinds))
    return [j for j in rows if not any(contains(i, j) for i in rows)]


def by_name(states: Sequence[AssignmentState]) -> dict[str, AssignmentState]:
    """Return panels of different kinds by their first observations' names, of which the second is called `NAME-2`."""
    found: dict[str, AssignmentState] = {}
    for state in of_different_kinds(states):
        name = state.panel.observations[0].name
        same = sum(other.panel.observations[0].name == name for other in found.values())
        found[f"{name}-{same + 1}" if same else name] = state
    return found


def viewing_of(state: AssignmentState, observation: str | None = None) -> Viewing:
    """Return how pictures of a panel come about, with what was learned of its cameras.

    Raises:
        UserError: if the run was trained on samples themselves, not on pictures of them.
    """
    if isinstance(state.panel.projection, Identity):
        raise UserError("the run was trained on samples, not on pictures; say how pictures come about (viewing=...)")
    observations = [o for o in state.panel.observations if observation in (None, o.name)]
    return Viewing.of(observations, state.learned.draw if state.learned is not None else None)


def novelty_of(state: AssignmentState, viewing: Viewing, seed: int = 0) -> Novelty | None:
    """Return what compares pictures with those that a panel was trained on; by held-out ones if there are.

    None if it was trained on a single one.

    Args:
        viewing: its projection prepares the pictures.
    """
    panel, rng = state.panel, generator_at(seed, 0, "compared pictures")
    rows = torch.randperm(len(panel), generator=rng)[:COMPARED]
    count = max(1, len(rows) // 10)
    if panel.held_out is None and len(panel) < 2:
        return None
    if panel.held_out is None:
        held_out, pictures = panel.batch(rows[:count]), panel.batch(rows[count:])
    else:
        held_out, pictures = panel.held_out.floats(), panel.batch(rows)
    prepare, masks = viewing.projection.prepare, viewing.projection.silhouettes
    return Novelty.fitted(prepare(pictures), prepare(held_out), prepare, seed=seed, masks=masks)
