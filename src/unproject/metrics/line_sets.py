"""How near generated line integrals are to held-out measured ones: where there is no image to compare with."""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError
from .feature_sets import frechet_distance, kernel_distance
from .score import Score


@torch.no_grad()
def line_scores(generated: Tensor, reference: Tensor, *, seed: int = 0) -> dict[str, Score]:
    """Distances of two sets of lines (N, C, D), all directions together, as they are: no gauge, no alignment.

    Draw the generated ones from the directions that the references have; the scores cannot tell a wrong image from a
    wrong mix of directions. Both distances are of the readings, standardised by the references' mean and deviation.

    Returns:
        `frechet_line` and `kernel_line`: see `feature_sets`.

    Raises:
        UserError: for fewer than two lines in a set, lines of different lengths, or NaN.
    """
    if generated.dim() != 3 or generated.shape[1:] != reference.shape[1:] or min(len(generated), len(reference)) < 2:
        raise UserError(
            f"line scores: give at least two lines of one length a set, not {tuple(generated.shape)} and "
            f"{tuple(reference.shape)}"
        )
    if not bool(torch.isfinite(generated).all() and torch.isfinite(reference).all()):
        raise UserError("line scores: there are readings that are NaN or infinite; replace them")
    mean, deviation = reference.mean(), reference.std().clamp_min(1e-12)
    x, y = ((lines.flatten(1) - mean) / deviation for lines in (generated, reference))
    n = len(x)
    sizes = f"{x.shape[1]} readings standardised, {n} generated vs {len(y)} reference, directions as given"
    return {
        "frechet_line": Score(frechet_distance(x, y), f"Fréchet distance, {sizes}", n, seed),
        "kernel_line": Score(kernel_distance(x, y), f"unbiased cubic-kernel mmd^2, {sizes}", n, seed),
    }
