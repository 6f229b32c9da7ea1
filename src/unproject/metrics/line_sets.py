"""Distances between generated and held-out line integrals, for collections without reference images."""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError
from .feature_sets import frechet_distance, kernel_distance
from .score import Score


@torch.no_grad()
def line_scores(generated: Tensor, reference: Tensor, *, seed: int = 0) -> dict[str, Score]:
    """Score generated lines (N, C, D) against reference ones, all directions together, without gauge or alignment.

    The generated lines must have the references' distribution of directions: the scores do not separate wrong images
    from a wrong distribution. Both distances are of the readings, standardised by the references' mean and deviation.

    Returns:
        `frechet_line` and `kernel_line`: see `feature_sets`.

    Raises:
        UserError: for fewer than two lines in a set, lines of different lengths, or NaN.

    Examples:
        >>> import torch, unproject as up
        >>> lines = torch.rand(8, 1, 16, generator=torch.Generator().manual_seed(0))
        >>> abs(up.metrics.line_scores(lines, lines)["frechet_line"].value) < 1e-6
        True
    """
    if generated.dim() != 3 or generated.shape[1:] != reference.shape[1:] or min(len(generated), len(reference)) < 2:
        raise UserError(
            f"line scores: give at least two lines of one length a set, not {tuple(generated.shape)} and "
            f"{tuple(reference.shape)}"
        )
    if not bool(torch.isfinite(generated).all() and torch.isfinite(reference).all()):
        raise UserError("line scores: some readings are NaN or infinite; fix or leave out those lines")
    mean, deviation = reference.mean(), reference.std().clamp_min(1e-12)
    x, y = ((lines.flatten(1) - mean) / deviation for lines in (generated, reference))
    n = len(x)
    sizes = f"{x.shape[1]} readings standardised, {n} generated vs {len(y)} reference, directions as given"
    return {
        "frechet_line": Score(frechet_distance(x, y), f"Fréchet distance, {sizes}", n, seed),
        "kernel_line": Score(kernel_distance(x, y), f"unbiased cubic-kernel mmd^2, {sizes}", n, seed),
    }
