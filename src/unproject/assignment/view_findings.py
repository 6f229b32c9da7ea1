"""What a view predictor's probabilities say: whether views are found, and whether the world is an artificial one.

    I(k; y) = H(mean q) - mean H(q), nats,      of held-out pictures and of the generator's own projections

Little information in both: views were not found, or objects look alike from all sides; pictures cannot tell which. Much
in the projections and less in pictures: generated shapes are more telling than real ones are.

Bodies of revolution are their own mirror images from any side. Silhouettes that are leave open whether objects look
alike from all sides or their views are to be found: what was learned decides, and could be otherwise.
"""

from __future__ import annotations

import math

from torch import Tensor

from ..metrics import Finding, Score
from ..ops.outlines import mirror_iou

FOUND = 0.4
"""Share of log K nats that pictures hold at least, if views are found."""
WORLD = (0.75, 0.5)
"""Levels of the information of pictures over that of projections (doubtful, failed)."""


MIRRORED = 0.95
"""Median IoU of silhouettes with their mirror images from which on they may be of bodies of revolution. It is 0.99 or
more of lamps and of tables, seen from level, 0.9 of drawers from 14 degrees above, 0.79 of cars, 0.5 of chairs."""


def information(p: Tensor) -> float:
    """Return I(k; y) = H(mean p) - mean H(p) of the probabilities p (N, K), in nats."""
    return (entropy(p.mean(0)) - entropy(p).mean()).item()


def entropy(p: Tensor) -> Tensor:
    """Return the entropy of each row of p (..., K), in nats."""
    return -(p * p.clamp_min(1e-12).log()).sum(-1)


def chance(n: int, views: int) -> float:
    """Return the information, nats, that certain but random predictions of n pictures seem to hold: (K - 1) / 2n.

    References:
        Miller 1955, Note on the bias of information estimates.
    """
    return (views - 1) / (2 * n)


def are_found(p: Tensor) -> bool:
    """Whether views are found, by the probabilities p (N, K) of real pictures."""
    return information(p) >= FOUND * math.log(p.shape[1])


def view_findings(real: Tensor, generated: Tensor, silhouettes: Tensor | None = None) -> list[Finding]:
    """Judge the probabilities (M, K) of real pictures and (N, K) of projections of samples.

    Args:
        silhouettes: (M, 1, H, W), the real pictures if they are silhouettes.
    """
    of_real, of_generated, most = information(real), information(generated), math.log(real.shape[1])
    how = (
        f"nats of log {real.shape[1]} = {most:.2f}, {len(real)} pictures; {of_generated:.2f} in {len(generated)} "
        f"projections of samples; chance {chance(len(real), real.shape[1]):.2f}"
    )
    lost = "views are not found, or objects look alike from all sides; pictures cannot tell which"
    says = f"views are found ({of_real:.2f} of {most:.2f} nats)" if are_found(real) else lost
    advice = "train longer, try another --seed, or give known views"
    found = [Finding("views", Score(of_real, how, len(real)), FOUND * most, -math.inf, says, advice)]
    telling = of_generated >= FOUND * most
    mirrored = None if silhouettes is None else mirror_iou(silhouettes).median().item()
    if mirrored is not None and mirrored >= MIRRORED and telling:
        found = [mirror_finding(mirrored, len(real)), *found]
    return found + ([world_finding(of_real, of_generated, len(real))] if telling else [])


def mirror_finding(mirrored: float, n: int) -> Finding:
    """Say what silhouettes leave open that are their own mirror images, where views of generated shapes can be told."""
    score = Score(mirrored, "median IoU of a silhouette with its mirror image", n)
    says = f"pictures are their own mirror images (IoU {mirrored:.2f}): round objects would explain them as well"
    advice = "look at the shapes; --axisymmetric 6, or more, prefers round ones"
    return Finding("mirror", score, MIRRORED, math.inf, says, advice)


def world_finding(of_real: float, of_generated: float, n: int) -> Finding:
    """Judge whether generated shapes are more telling of views than real pictures are."""
    ratio = of_real / of_generated
    how = f"information of pictures over that of projections of samples, {of_generated:.2f} nats"
    few = "" if ratio > WORLD[0] else "only "
    says = f"pictures hold {few}{ratio:.0%} of the view information of generated ones"
    says += ": shapes are probably wrong" if few else ""
    return Finding("world", Score(ratio, how, n), *WORLD, says, "train longer, or try another --seed")
