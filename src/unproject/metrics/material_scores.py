"""Scores of generated against true materials: each map, renderings, and correlations between maps.

========================== ======================================================================================
`patch_MAP`                sliced Wasserstein distance of patches, mean of levels (`patches`)
`kernel_MAP`               kernel distance of texture features (`patches`)
`correlation_error...`     cross-map correlations: overall, by scale, by pair of maps (`map_correlation`)
`diversity`                mean distance between generated materials over that between true ones
`precision` ... `coverage` balls around the texture features of all maps (`feature_sets`)
========================== ======================================================================================

MAP is diffuse, specular, roughness or normal, or the name of a rendering of both sets. No feature is learned, so no
weights are downloaded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from .._types import UserError
from ..ops.maps import MAPS, unpack_maps
from .feature_sets import density_coverage, kernel_distance, precision_recall
from .map_correlation import correlation_error
from .patches import PROJECTIONS, SIDE, check_pair, patch_distance, standardised, texture_features
from .score import Score
from .shape_scores import drawn

MIN_MATERIALS, MAX_MATERIALS = 6, 5000

Pair = tuple[Tensor, Tensor]


@torch.no_grad()
def material_scores(
    generated: Tensor, truth: Tensor, seed: int = 0, rendered: Mapping[str, Pair] | None = None
) -> dict[str, Score]:
    """Score generated materials against true ones.

    Most scores depend on the sizes of the sets, which are part of the protocol: compare with a baseline, such as other
    true materials, of the same size.

    Args:
        generated: (G, 8, H, W) or (G, 10, H, W) as `ops.maps` packs them.
        truth: (T, ...), with as many channels.
        seed: of the patches and of the subsets drawn from larger sets.
        rendered: name → renderings of generated and of true materials, (N, 3, H, W) each, under one light and view.

    Returns:
        `patch_diffuse`, `kernel_diffuse`, and the same of `specular`, `roughness`, `normal` and each name in
        `rendered`; `correlation_error`, and of each scale `correlation_error_64`, ..., `correlation_error_mean`,
        and each pair `correlation_error_diffuse_normal`, ...; `diversity`, `precision`, `recall`, `density`,
        `coverage`.

    Raises:
        UserError: for sets of fewer than six materials, materials or renderings of different sizes or smaller than
            16x16, other than 8 or 10 channels, NaN, or a rendering with the name of a map.
    """
    check_pair(generated, truth, MIN_MATERIALS, "materials")
    rendered = rendered or {}
    taken = sorted(set(rendered) & set(MAPS))
    if taken:
        raise UserError(f"material scores: {taken[0]!r} is a map; give that rendering another name")
    for name, pair in rendered.items():
        check_pair(*pair, MIN_MATERIALS, f"renderings {name!r}")
    x, y = unpack_maps(generated), unpack_maps(truth)
    scores, features = {}, []
    for name in MAPS:
        found, groups = _texture_scores(name, (x[name], y[name]), seed)
        scores |= found
        features.append(groups)
    for name, pair in rendered.items():
        scores |= _texture_scores(name, pair, seed)[0]
    return scores | _correlation_scores(generated, truth) | _set_scores(features, _sizes(generated, truth), seed)


def _sizes(generated: Tensor, truth: Tensor) -> str:
    height, width = truth.shape[-2:]
    return f"{len(generated)} generated vs {len(truth)} true at {height}x{width}"


def _texture_scores(name: str, pair: Pair, seed: int) -> tuple[dict[str, Score], tuple[list[Tensor], list[Tensor]]]:
    """Return the patch and the kernel distance of two sets of images, and the groups of features of both."""
    n, sizes = len(pair[0]), _sizes(*pair)
    groups = texture_features(pair[0]), texture_features(pair[1])
    x, y = standardised(*groups)
    patch = patch_distance(*pair, seed=seed)
    levels = ", ".join(map(str, patch.levels))
    how = (
        f"sliced Wasserstein-1 of {SIDE}x{SIDE} patches in the truth's deviations, mean of Laplacian levels {levels}, "
        f"{PROJECTIONS} projections, up to {patch.patches} patches an image and level, {sizes}"
    )
    kernel = f"unbiased cubic-kernel mmd^2 of {x.shape[1]} texture features standardised by the truth, {sizes}"
    scores = {
        f"patch_{name}": Score(patch.mean, how, n, seed),
        f"kernel_{name}": Score(kernel_distance(x, y), kernel, n),
    }
    return scores, groups


def _correlation_scores(generated: Tensor, truth: Tensor) -> dict[str, Score]:
    n, sizes, error = len(generated), _sizes(generated, truth), correlation_error(generated, truth)
    scales = ", ".join(error.truth.scales)
    how = f"rms difference of Pearson correlations between maps' bands, {{}}, {sizes}"
    overall = {"correlation_error": Score(error.overall, how.format(f"6 pairs at scales {scales}"), n)}
    by_scale = {
        f"correlation_error_{scale}": Score(value, how.format(f"6 pairs at scale {scale}"), n)
        for scale, value in error.by_scale().items()
    }
    by_pair = {
        f"correlation_error_{a}_{b}": Score(value, how.format(f"{a} and {b} at scales {scales}"), n)
        for (a, b), value in error.by_pair().items()
    }
    return overall | by_scale | by_pair


def _set_scores(features: Sequence[tuple[list[Tensor], list[Tensor]]], sizes: str, seed: int) -> dict[str, Score]:
    """Compute diversity, precision, recall, density and coverage on the features of all maps, of sets of equal size."""
    x, y = standardised(*([group for side in sides for group in side] for sides in zip(*features)))
    least = min(len(x), len(y), MAX_MATERIALS)
    x, y = x[drawn(len(x), least, seed)], y[drawn(len(y), least, seed)]
    where = f"{x.shape[1]} texture features of all maps standardised by the truth, {least} vs {least} of {sizes}"
    precision, recall = precision_recall(x, y)
    density, coverage = density_coverage(x, y)
    diversity = _spread(x) / max(_spread(y), 1e-9)
    return {
        "diversity": Score(diversity, f"mean distance of two items over that of two true ones, {where}", least, seed),
        "precision": Score(precision, f"precision, balls to the 3rd neighbour, {where}", least, seed),
        "recall": Score(recall, f"recall, balls to the 3rd neighbour, {where}", least, seed),
        "density": Score(density, f"density, balls to the 5th neighbour, {where}", least, seed),
        "coverage": Score(coverage, f"coverage, balls to the 5th neighbour, {where}", least, seed),
    }


def _spread(x: Tensor) -> float:
    """Return the mean distance of two different rows."""
    return torch.pdist(x).mean().item()
