"""Distances of two sets of feature vectors, x (m, d) and y (n, d).

Fréchet, of the normal distributions with the sets' means μ and covariances C:

    FD = |μ_x - μ_y|² + tr(C_x + C_y - 2 (C_x^½ C_y C_x^½)^½)

Kernel distance, the unbiased squared maximum mean discrepancy with the cubic kernel of KID:

    k(a, b) = (a·b / d + 1)³
    KD = Σ_{i≠j} k(x_i, x_j) / m(m-1) + Σ_{i≠j} k(y_i, y_j) / n(n-1) - 2 Σ_{i,j} k(x_i, y_j) / mn

With B(r_i) the ball around reference r_i whose radius is the distance to its k-th nearest other reference, and B(g_j)
likewise:

    precision = share of g in the union of the B(r)       recall = share of r in the union of the B(g)
    density = Σ_ij [g_j ∈ B(r_i)] / (k · number of g)     coverage = share of r whose ball contains some g

FD falls with the sizes of the sets (its bias is of the order of d/n); the expectation of KD is 0 for two samples of one
distribution, so it may be slightly negative; density may exceed 1.

References:
    Heusel et al., GANs trained by a two time-scale update rule, NeurIPS 2017 (Fréchet).
    Bińkowski et al., Demystifying MMD GANs, ICLR 2018 (KID). Gretton et al., JMLR 2012 (the unbiased estimator).
    Kynkäänniemi et al., Improved precision and recall metric, NeurIPS 2019.
    Naeem et al., Reliable fidelity and diversity metrics for generative models, ICML 2020.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError

ROWS = 1024
"""Rows of a matrix of kernels that are computed at once: of 60,000 items a whole one takes 29 GB."""


def frechet_distance(x: Tensor, y: Tensor) -> float:
    """Compute the Fréchet distance with unbiased covariances, in double precision.

    Args:
        x, y: (m, d) and (n, d).

    Raises:
        UserError: for fewer than two items in a set, different d, or NaN.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        >>> round(up.metrics.frechet_distance(x, x + torch.tensor([3.0, 4.0])), 6)
        25.0
    """
    x, y = _checked("Fréchet distance", x, y)
    c_x, c_y = (value.T.cov().reshape(2 * value.shape[1:]) for value in (x, y))
    values, vectors = torch.linalg.eigh(c_x)
    root = vectors * values.clamp_min(0).sqrt() @ vectors.T
    cross = torch.linalg.eigvalsh(root @ c_y @ root).clamp_min(0).sqrt().sum()
    return ((x.mean(0) - y.mean(0)).square().sum() + c_x.trace() + c_y.trace() - 2 * cross).item()


def kernel_distance(x: Tensor, y: Tensor) -> float:
    """Compute the unbiased squared maximum mean discrepancy with the cubic kernel of x (m, d) and y (n, d).

    Raises:
        UserError: for fewer than two items in a set, different d, or NaN.

    Examples:
        >>> import torch, unproject as up
        >>> x, y = torch.randn(2, 500, 4, generator=torch.Generator().manual_seed(0))
        >>> abs(up.metrics.kernel_distance(x, y)) < 0.1 < up.metrics.kernel_distance(x, y + 1)
        True
    """
    x, y = _checked("kernel distance", x, y)
    across = _sum_of_kernels(x, y) / (len(x) * len(y))
    return (_mean_of_pairs(x) + _mean_of_pairs(y) - 2 * across).item()


def _mean_of_pairs(x: Tensor) -> Tensor:
    with_themselves = ((x.square().mean(1) + 1) ** 3).sum()
    return (_sum_of_kernels(x, x) - with_themselves) / (len(x) * (len(x) - 1))


def _sum_of_kernels(x: Tensor, y: Tensor) -> Tensor:
    return torch.stack([cubic_kernel(rows, y).sum() for rows in x.split(ROWS)]).sum()


def cubic_kernel(x: Tensor, y: Tensor) -> Tensor:
    """Compute K[i, j] = (x_i · y_j / d + 1)³ of x (m, d) and y (n, d)."""
    return (x @ y.T / x.shape[1] + 1) ** 3


def precision_recall(generated: Tensor, reference: Tensor, k: int = 3) -> tuple[float, float]:
    """Return (precision, recall) by balls to the k-th neighbour. Both depend on the sizes: give sets of equal size.

    With ρ_k(x) the distance of x to the k-th nearest other item of its own set, precision is the share of generated g
    with |g - r| ≤ ρ_k(r) for some reference r, and recall that of references r with |g - r| ≤ ρ_k(g) for some g.

    Args:
        generated, reference: features (N, F) and (M, F).
        k: neighbours.

    Raises:
        UserError: for sets of at most k items, of different features, or NaN.

    References:
        Kynkäänniemi et al. 2019, Improved Precision and Recall Metric for Assessing Generative Models.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.arange(8.0)[:, None]
        >>> up.metrics.precision_recall(x, x), up.metrics.precision_recall(x + 100, x)
        ((1.0, 1.0), (0.0, 0.0))
    """
    generated, reference = _checked("precision and recall", generated, reference, k + 1)
    across = torch.cdist(generated, reference)
    precision = (across <= _radii(reference, k)).any(1).double().mean()
    recall = (across <= _radii(generated, k)[:, None]).any(0).double().mean()
    return precision.item(), recall.item()


def density_coverage(generated: Tensor, reference: Tensor, k: int = 5) -> tuple[float, float]:
    """Return (density, coverage) by balls to the k-th neighbour around the references.

    With ρ_k(r) the distance of a reference to the k-th nearest other one, density is the number of pairs with
    |g - r| ≤ ρ_k(r) over k N, and coverage the share of references that are in such a pair.

    Args:
        generated, reference: features (N, F) and (M, F).
        k: neighbours.

    Raises:
        UserError: for sets of at most k items, of different features, or NaN.

    References:
        Naeem et al. 2020, Reliable Fidelity and Diversity Metrics for Generative Models.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.arange(8.0)[:, None]
        >>> up.metrics.density_coverage(x + 100, x)
        (0.0, 0.0)
    """
    generated, reference = _checked("density and coverage", generated, reference, k + 1)
    inside = torch.cdist(generated, reference) <= _radii(reference, k)
    return inside.double().sum().item() / (k * len(generated)), inside.any(0).double().mean().item()


def _radii(x: Tensor, k: int) -> Tensor:
    """Return the distance of each row to its k-th nearest other row."""
    return torch.cdist(x, x).fill_diagonal_(float("inf")).kthvalue(k, dim=1).values


def _checked(what: str, x: Tensor, y: Tensor, least: int = 2) -> tuple[Tensor, Tensor]:
    if min(len(x), len(y)) < least or x.dim() != 2 or x.shape[1:] != y.shape[1:]:
        raise UserError(
            f"{what}: give at least {least} items of one size a set, not {tuple(x.shape)} and {tuple(y.shape)}"
        )
    if not bool(x.isfinite().all() and y.isfinite().all()):
        raise UserError(f"{what}: some features are NaN or infinite; leave out those items")
    return x.double(), y.double()
