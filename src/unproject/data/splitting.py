"""Splitting: which items of a collection are held out, so that none of them shows a shape of the others."""

from __future__ import annotations

import re
from collections.abc import Sequence

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError

FLIPPED = " flipped"
"""How the name of a mirror image ends."""
MIN_GROUPS = 8
"""Groups that are held out at least; of few groups a quarter."""
MAX_NEIGHBOURS = 16
"""Neighbours in a group, where names tell no shapes."""
RENDERED = re.compile(r"#\d+( flipped)?$")


def split_rows(names: Sequence[str], share: float, seed: int, source: str) -> tuple[Tensor, Tensor]:
    """Return the rows that are kept and those that are held out, both rising.

    Raises:
        UserError: for a share that is not between 0 and 1, or a single group.
    """
    if not 0 < share < 1:
        raise UserError(f"{source}: a share of {share:g} cannot be held out; give more than 0 and less than 1")
    group = groups(names, share)
    count = int(group.max()) + 1
    if count < 2:
        raise UserError(
            f"{source}: shows a single shape, of which nothing can be held out; give more, or hold out none "
            "(--no-augment)"
        )
    wanted = min(max(round(share * count), min(MIN_GROUPS, count // 4), 1), count - 1)
    chosen = torch.randperm(count, generator=generator_at(seed, 0, "held out"))[:wanted]
    out = torch.isin(group, chosen)
    return (~out).nonzero()[:, 0], out.nonzero()[:, 0]


def groups(names: Sequence[str], share: float) -> Tensor:
    """Return the group of each item, (N,): of its shape if names tell it, else of its neighbours."""
    if any(RENDERED.search(name) for name in names):
        shapes = [RENDERED.sub("", name) for name in names]
        number = {shape: i for i, shape in enumerate(dict.fromkeys(shapes))}
        return torch.tensor([number[shape] for shape in shapes])
    own = [name.removesuffix(FLIPPED) for name in names]  # a mirror image is no other picture
    number = {name: i for i, name in enumerate(dict.fromkeys(own))}
    size = min(max(round(share * len(number)) // MIN_GROUPS, 1), MAX_NEIGHBOURS)
    return torch.tensor([number[name] for name in own]) // size
