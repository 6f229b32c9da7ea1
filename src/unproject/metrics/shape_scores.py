"""MMD, COV and 1-NNA of generated volumes against reference volumes, on 1 - IoU and on Chamfer distance.

The gauge is removed first, once for the whole set. See `shape_sets` for the formulas, `distances` for the distances and
`gauge` for the gauge.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from .distances import THRESHOLD, chamfer, check_set, one_minus_iou, surface_points
from .gauge import Gauge, apply, best_gauge, dihedral
from .score import Score
from .shape_sets import coverage, minimum_matching_distance, one_nearest_neighbour_accuracy

SELECTION = 256


@torch.no_grad()
def shape_scores(
    generated: Tensor,
    reference: Tensor,
    *,
    selection: Tensor | None = None,
    bins: int | None = 16,
    points: int = 512,
    seed: int = 0,
) -> dict[str, Score]:
    """Score generated volumes against reference volumes.

    All scores depend on the sizes of the sets, which are part of the protocol: compare with a baseline, such as the
    training set, of the same size. MMD and COV are given twice: for the whole sets and, as in the literature, for sets
    of equal size: as the mean over all choices of so many generated shapes, or on references drawn from more of them.
    1-NNA is computed for equal sizes only, on a subset drawn from the larger set, as its ideal value is 0.5 only then;
    of one shape a set there is none.

    Args:
        generated: (G, N, N, N) in [0, 1].
        reference: (R, N, N, N), in one frame and upright.
        selection: other shapes of the reference's distribution, (S, N, N, N), in the same frame, on which the gauge is
            chosen (default: the references, which biases the scores a little; the protocol names it). At most 256 are
            used, and at most 256 generated ones, drawn with the seed.
        bins: the gauge's rotations are multiples of 2π / bins; None for no gauge.
        points: points a surface for the Chamfer distance.
        seed: of the surface points and of the subsets drawn from larger sets.

    Returns:
        `mmd_iou`, `cov_iou`, `mmd_iou_equal`, `cov_iou_equal`, `1nna_iou`, and the same of `chamfer`; `empty`, the
        share of generated volumes with nothing above 0.5; and, unless bins is None, `gauge_turn` (in bins) and
        `gauge_reflected` (0 or 1), which were applied to the generated set.

    Raises:
        UserError: for an empty set, NaN, or volumes that are not cubes of one size.

    Examples:
        >>> import torch, unproject as up
        >>> volumes = torch.rand(4, 8, 8, 8, generator=torch.Generator().manual_seed(0))
        >>> scores = up.metrics.shape_scores(volumes, volumes, bins=2, points=16)
        >>> scores["mmd_iou"].value, scores["cov_iou"].value
        (0.0, 1.0)
    """
    check_set(generated, "generated")
    check_set(reference, "reference")
    if generated.ndim != 4 or generated.shape[1:] != reference.shape[1:]:
        raise UserError(
            f"shape scores: generated volumes are {tuple(generated.shape)} and references {tuple(reference.shape)}; "
            "give (count, N, N, N) volumes of one size"
        )
    gauge, chosen = _choose_gauge(generated, reference, selection, bins, seed)
    turned = apply(generated, gauge) if gauge else generated
    setting = f"{generated.shape[-1]}^3 at {THRESHOLD}, {{}} generated vs {{}} reference, {chosen}"
    cloud = f"chamfer: sum of two-sided mean squared distances, {points} points on voxel faces, box side 2"
    clouds = [surface_points(x, points, generator_at(seed, i, "surface")) for i, x in enumerate((turned, reference))]
    scores = set_scores("iou", one_minus_iou, turned, reference, f"1-iou), {setting}", seed)
    scores |= set_scores("chamfer", chamfer, clouds[0], clouds[1], f"{cloud}), {setting}", seed)
    scores["empty"] = _empty(generated, seed)
    return scores | (_gauge_scores(gauge, len(generated), chosen, seed) if gauge else {})


def set_scores(
    name: str,
    distance: Callable[[Tensor, Tensor], Tensor],
    generated: Tensor,
    reference: Tensor,
    setting: str,
    seed: int = 0,
) -> dict[str, Score]:
    """Return `mmd_NAME`, `cov_NAME`, both also with `_equal`, and `1nna_NAME` of two sets under one distance.

    Of one item a set there is no `1nna_NAME`: it has no neighbour of its own set.

    `setting` completes the protocol after "mmd(" and has two `{}` for the sizes of the sets.
    """
    across = distance(generated, reference)
    count, references = across.shape
    least = min(count, references)
    rows, columns = drawn(count, least, seed), drawn(references, least, seed)
    matched = across[:, columns]
    whole, equal = setting.format(count, references), setting.format(least, least)
    choices = setting.format(f"all choices of {least} of {count}", least)
    scores = {
        f"mmd_{name}": Score(minimum_matching_distance(across), f"mmd({whole}", count, seed),
        f"cov_{name}": Score(coverage(across), f"cov({whole}", count, seed),
        f"mmd_{name}_equal": Score(minimum_matching_distance(matched, least), f"mmd({choices}", count, seed),
        f"cov_{name}_equal": Score(coverage(matched, least), f"cov({choices}", count, seed),
    }
    if least < 2:
        return scores
    accuracy = one_nearest_neighbour_accuracy(
        distance(generated[rows], generated[rows]), matched[rows], distance(reference[columns], reference[columns])
    )
    return scores | {f"1nna_{name}": Score(accuracy, f"1nna({equal}", least, seed)}


def drawn(count: int, n: int, seed: int) -> Tensor:
    """Return sorted indices of min(n, count) of `count` items: all, or a subset that depends on the seed only."""
    return torch.randperm(count, generator=generator_at(seed, 0, "subset"))[:n].sort().values


def _choose_gauge(
    generated: Tensor, reference: Tensor, selection: Tensor | None, bins: int | None, seed: int
) -> tuple[Gauge | None, str]:
    """Return the gauge and the part of the protocol that tells how it was chosen."""
    if bins is None:
        return None, "gauge as it stands"
    others, whose = (reference, "the references") if selection is None else (selection, "other shapes")
    check_set(others, "selection")
    some, chosen_on = (items[drawn(len(items), SELECTION, seed)] for items in (generated, others))
    sizes = f"{len(some)} generated to {len(chosen_on)} of {whose}"
    return best_gauge(some, chosen_on, bins), f"best of {len(dihedral(bins))} dihedral gauges by mmd(1-iou) of {sizes}"


def _empty(generated: Tensor, seed: int) -> Score:
    share = (generated.flatten(1).amax(1) <= THRESHOLD).double().mean().item()
    return Score(share, f"share of volumes with nothing above {THRESHOLD}", len(generated), seed)


def _gauge_scores(gauge: Gauge, n: int, chosen: str, seed: int) -> dict[str, Score]:
    turn = f"turn about y applied to the generated set, in 1/{gauge.bins} of a turn, {chosen}"
    reflected = f"1 if the generated set was reflected in x before the turn, {chosen}"
    return {
        "gauge_turn": Score(float(gauge.turn), turn, n, seed),
        "gauge_reflected": Score(float(gauge.reflected), reflected, n, seed),
    }
