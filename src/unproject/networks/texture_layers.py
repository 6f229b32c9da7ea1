"""Layers of generators of textures that repeat themselves: levels, and what maps fields to one map."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..ops.resampling import doubled
from .blocks import ModulatedScale

EITHER_SIGN = 6.0  # gives scales 1 ± 1 before training


def shares(fields: int, maps: int) -> list[Tensor]:
    """Return which fields (C,) each map begins with: a part of its own, or where there are too few all."""
    owner = torch.arange(fields) % maps
    return [owner == k if k < fields else torch.ones_like(owner, dtype=torch.bool) for k in range(maps)]


class Pixelwise(nn.Module):
    """A perceptron of two layers, modulated by a vector, that maps fields (B, C, H, W) to one map, pixel by pixel.

    Before training, the sign of a field's weight in a map varies with the vector, so that the map is positively
    correlated with its field in some materials and negatively in others. Training can then change the proportion. If
    all materials had the same sign, changing it would pass through maps without contrast, which discriminators reject.

    Args:
        hidden: length of the vector.
        fields: C.
        first: initial bias of the map's channels.
    """

    def __init__(self, hidden: int, fields: int, first: tuple[float, ...]) -> None:
        super().__init__()
        self.mix = nn.Conv2d(fields, fields, 1)
        self.norm = ModulatedScale(hidden, fields)
        self.last = nn.Conv2d(fields, len(first), 1)
        nn.init.normal_(self.norm.modulation.weight[:fields], std=EITHER_SIGN * hidden**-0.5)
        with torch.no_grad():
            self.last.weight *= 0.5
            self.last.bias.copy_(torch.tensor(first))  # pyright: ignore[reportOptionalMemberAccess]

    @torch.no_grad()
    def begin_with(self, own: Tensor) -> None:
        """Let the map begin as one of these fields (C,) alone, of the same variance.

        Maps that begin with fields of their own learn from the first step on how they go together. Maps that begin with
        those of another, and should not go with it, have no gradient towards others: their contrast shrinks instead.
        """
        self.mix.weight *= (own * (len(own) / own.sum()) ** 0.5)[:, None, None]

    def forward(self, fields: Tensor, hidden: Tensor) -> Tensor:
        return self.last(F.leaky_relu(self.norm(self.mix(fields), hidden), 0.2)).contiguous()


class Waves(nn.Module):
    """Waves along x and y added to fields: a vector chooses their cycles, the map of places their phase.

    Along each axis Σ_n p_n (cos, sin)(2π n (x - s)) of n = 1 to N cycles a side, with p the softmax of N + 1 linear
    functions of the vector, the first for none, and s in sides: where the first channel of the map of places is
    largest, as its slowest wave tells. A map that is shifted gives waves that are shifted as much.

    Patterns of equal distances, such as ribs or threads, need a signal that is periodic from edge to edge; convolutions
    of noise have none.

    Args:
        hidden: length of the vector.
        fields: C.
        cycles: N.

    References:
        Bergmann et al. 2017, Learning texture manifolds with the periodic spatial GAN.
    """

    def __init__(self, hidden: int, fields: int, cycles: int) -> None:
        super().__init__()
        self.choice = nn.Linear(hidden, 2 * (cycles + 1))
        nn.init.normal_(self.choice.weight, std=3 * hidden**-0.5)
        self.mix = nn.Conv2d(4, fields, 1, bias=False)
        nn.init.normal_(self.mix.weight, std=0.3)

    def forward(self, hidden: Tensor, places: Tensor, size: int, times: int = 1) -> Tensor:
        """Return what is added to fields (B, C, size, size), of maps `times` as large as those of training."""
        share = self.choice(hidden).float().view(len(hidden), 2, -1, 1).softmax(2)[:, :, 1:]
        x = (torch.arange(size, device=hidden.device) + 0.5) / size
        cycles = times * torch.arange(1, share.shape[2] + 1, device=hidden.device)
        turn = 2 * math.pi * cycles[:, None] * (x - _crest(places)[:, :, None, None])
        along = torch.stack([(share * wave).sum(2) for wave in (turn.cos(), turn.sin())], 2)
        down, across = along[:, 0, :, :, None], along[:, 1, :, None]
        both = [down.expand(-1, -1, -1, size), across.expand(-1, -1, size, -1)]
        return self.mix(torch.cat(both, 1))


def _crest(places: Tensor) -> Tensor:
    """Return where the slowest wave of the first channel is largest, down and across, (B, 2), in sides."""
    along = torch.stack([places[:, 0].mean(2), places[:, 0].mean(1)], 1)
    turn = 2 * math.pi * torch.arange(along.shape[2], device=along.device) / along.shape[2]
    cosine, sine = ((along * wave).sum(2) for wave in (turn.cos(), turn.sin()))
    return torch.atan2(sine, cosine) / (2 * math.pi)


class TilingLevel(nn.Module):
    """A periodic level: convolution, bilinear doubling, noise, modulated scale, ReLU."""

    def __init__(self, hidden: int, before: int, after: int, sources: int) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, 3, bias=False)
        self.norm = ModulatedScale(hidden, after)
        self.strength = nn.Parameter(torch.randn(after, sources) * 0.2 * sources**-0.5)

    def forward(self, x: Tensor, hidden: Tensor, noise: Tensor) -> Tensor:
        # A border of one more texel than the convolution needs, for the interpolation; removed afterwards.
        x = doubled(self.convolution(tiled(x, 2)))
        x = x[:, :, 2:-2, 2:-2] + F.conv2d(noise, self.strength[:, :, None, None])
        return F.relu(self.norm(x, hidden))


def without_lattice(x: Tensor) -> Tensor:
    """Equalise the means over places of each four channels of (B, 4 C, H, W) that a sub-pixel shuffle interleaves.

    Otherwise a constant difference of the four, visible as a lattice, is easily learned.
    """
    mean = x.mean((2, 3), keepdim=True)
    each = mean.view(len(x), -1, 4, 1, 1)
    return x - (each - each.mean(2, keepdim=True)).view_as(mean)


def tiled(x: Tensor, border: int) -> Tensor:
    """Pad x periodically."""
    return F.pad(x, (border,) * 4, mode="circular")
