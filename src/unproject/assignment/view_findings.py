"""What a view predictor's probabilities say: whether views are found, and whether the world is an artificial one.

    I(k; y) = H(mean q) - mean H(q), nats,      of pictures and of the generator's own projections
    U = I(k; y) / H(mean q)                     what a picture tells of its view, as a share of what there is to tell

Photographs are taken from some sides more than from others, and then there is less to tell than log K nats. (U is the
uncertainty coefficient of Theil 1970.)

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
"""The least U of pictures whose views are found."""
WORLD = (0.75, 0.5)
"""Levels of the U of pictures over that of projections (doubtful, failed)."""


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


def to_tell(p: Tensor) -> float:
    """Return what there is to tell, H(mean p) of the probabilities p (N, K), nats: as of two views at least."""
    return max(entropy(p.mean(0)).item(), math.log(2))


def are_found(p: Tensor) -> bool:
    """Whether views are found, by the probabilities p (N, K) of real pictures."""
    return information(p) >= FOUND * to_tell(p)


def view_findings(real: Tensor, generated: Tensor, silhouettes: Tensor | None = None) -> list[Finding]:
    """Judge the probabilities (M, K) of real pictures and (N, K) of projections of samples.

    Args:
        silhouettes: (M, 1, H, W), the real pictures if they are silhouettes.
    """
    of_real, most, count = information(real), to_tell(real), real.shape[1]
    how = (
        f"nats of {most:.2f}, the entropy of the views of {len(real)} pictures; {information(generated):.2f} of "
        f"{to_tell(generated):.2f} in {len(generated)} projections of samples; log {count} = {math.log(count):.2f}, "
        f"chance {chance(len(real), count):.2f}"
    )
    lost = "views are not found, or objects look alike from all sides; pictures cannot tell which"
    says = f"views are found ({of_real:.2f} of {most:.2f} nats)" if are_found(real) else lost
    advice = "train longer, try another --seed, or give known views"
    found = [Finding("views", Score(of_real, how, len(real)), FOUND * most, -math.inf, says, advice)]
    telling = are_found(generated)
    mirrored = None if silhouettes is None else mirror_iou(silhouettes).median().item()
    if mirrored is not None and mirrored >= MIRRORED and (telling or are_found(real)):
        found = [mirror_finding(mirrored, len(real)), *found]
    return found + ([world_finding(real, generated)] if telling else [])


def mirror_finding(mirrored: float, n: int) -> Finding:
    """Say what silhouettes leave open that are their own mirror images, where views are found or could be."""
    score = Score(mirrored, "median IoU of a silhouette with its mirror image", n)
    says = f"pictures are their own mirror images (IoU {mirrored:.2f}): round objects would explain them as well"
    advice = "look at the shapes; --axisymmetric 6, or more, prefers round ones"
    return Finding("mirror", score, MIRRORED, math.inf, says, advice)


def world_finding(real: Tensor, generated: Tensor) -> Finding:
    """Judge whether generated shapes are more telling of views than real pictures are."""
    of_real, of_generated = (information(p) / to_tell(p) for p in (real, generated))
    ratio = of_real / of_generated
    how = f"share of the entropy of views that pictures tell, over that of projections of samples, {of_generated:.2f}"
    few = "" if ratio > WORLD[0] else "only "
    says = f"pictures hold {few}{ratio:.0%} of the view information of generated ones"
    says += ": shapes are probably wrong" if few else ""
    return Finding("world", Score(ratio, how, len(real)), *WORLD, says, "train longer, or try another --seed")
