"""Statistics of the second order of an image, by octave: how its channels, slopes and energies go together.

Of an image (C, H, W), of three channels in opponent colours R+G+B, R-(G+B)/2 and G-B, each level of a Laplacian pyramid
b has the fields

    b_c,  ∂_x b_c,  ∂_y b_c,  b_c²,  |∇ b_0|²          (4 C + 1)

and statistics are, pooled over places, the logarithms of their variances and all of their correlations; those of the
energies b_c², |∇ b_0|² with the bands and the energies of the next coarser level; and the means of the channels. Maps
of a material that go together show in a photograph as such correlations, of brightness with the slope that a coloured
lamp from one side makes, say, where no single field shows it.

References:
    Portilla and Simoncelli, A parametric texture model based on joint statistics of wavelet coefficients, 2000.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor
from torch.autograd.function import once_differentiable

from .pyramids import laplacian_pyramid

SMALLEST = 8
FLOOR = 1e-6
"""Added to variances: of flat fields correlations are 0, and logarithms finite."""


def band_statistics(images: Tensor) -> Tensor:
    """Return statistics (B, S) of images (B, C, H, W), differentiable in them."""
    levels = laplacian_pyramid(opponent(images), SMALLEST)
    found = [images.mean((2, 3))]
    energies = []
    for band in levels:
        inner, slopes = band[:, :, :-1, :-1], (band[:, :, :-1, 1:], band[:, :, 1:, :-1])
        along = [moved - inner for moved in slopes]
        steepness = along[0][:, :1].square() + along[1][:, :1].square()
        energy = torch.cat([inner.square(), steepness], 1)
        fields = torch.cat([inner, *along, energy], 1).flatten(2)
        found.append(_within(fields))
        energies.append((energy, torch.cat([inner, energy], 1)))
    found += [_across(fine, coarse) for (fine, _), (_, coarse) in pairwise(energies)]
    return torch.cat(found, 1)


def opponent(images: Tensor) -> Tensor:
    """Return images of three channels as brightness and two differences of colours, others as they are."""
    if images.shape[1] != 3:
        return images
    r, g, b = images.unbind(1)
    return torch.stack([(r + g + b) / 3, r - (g + b) / 2, g - b], 1)


def _within(fields: Tensor) -> Tensor:
    """Return log variances and correlations of (B, F, P), (B, F + F (F - 1) / 2)."""
    covariance = Covariance.apply(fields)
    variance = covariance.diagonal(dim1=1, dim2=2) + FLOOR
    scale = variance.rsqrt()
    correlation = covariance * scale[:, :, None] * scale[:, None]
    i, j = torch.triu_indices(fields.shape[1], fields.shape[1], 1, device=fields.device)
    return torch.cat([variance.log(), correlation.flatten(1)[:, i * fields.shape[1] + j]], 1)


class Covariance(torch.autograd.Function):
    """Covariances (B, F, F) of fields (B, F, P) over places, C = Y Yᵀ / P with Y = X less its mean.

    The gradient by X is (G + Gᵀ) Y / P, whose mean over places is 0 as that of Y is: one product, where the chain rule
    step by step takes two, and three passes over what is as large as X.
    """

    @staticmethod
    def forward(ctx: Any, fields: Tensor) -> Tensor:
        centred = fields - fields.mean(2, keepdim=True)
        ctx.save_for_backward(centred)
        return centred @ centred.transpose(1, 2) / fields.shape[2]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        (centred,) = ctx.saved_tensors
        return ((gradient + gradient.transpose(1, 2)) / centred.shape[2]) @ centred


def _averaged(x: Tensor, height: int, width: int) -> Tensor:
    """Average over areas; on a GPU by products with matrices, whose gradients are added up in one order."""
    if not x.is_cuda:
        return F.interpolate(x, (height, width), mode="area")
    rows, columns = (area_matrix(n, m, x.dtype, x.device) for n, m in zip(x.shape[2:], (height, width)))
    return rows @ x @ columns.T


@lru_cache(maxsize=64)
def area_matrix(n: int, m: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Return the matrix (m, n) that averages n pixels over m areas."""
    return F.adaptive_avg_pool1d(torch.eye(n)[None], m)[0].T.to(device, dtype)


def _across(fine: Tensor, coarse: Tensor) -> Tensor:
    """Return correlations of energies of one level with fields of the next, (B, F F')."""
    fine = _averaged(fine, coarse.shape[2], coarse.shape[3]).flatten(2)
    fine, coarse = (x - x.mean(2, keepdim=True) for x in (fine, coarse.flatten(2)))
    scales = [(x.square().mean(2) + FLOOR).rsqrt() for x in (fine, coarse)]
    covariance = fine @ coarse.transpose(1, 2) / fine.shape[2]
    return (covariance * scales[0][:, :, None] * scales[1][:, None]).flatten(1)
