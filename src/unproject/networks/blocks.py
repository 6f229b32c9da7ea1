"""Building blocks: smooth upsampling, modulated normalisation, strided convolutions with weights for each head."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._types import UserError
from ..ops.resampling import doubled

Upsampling: TypeAlias = Literal["transposed", "nearest"]
MAX_WIDTH = 2**24
"""What is larger overflows torch's sizes; what fits is for memory to say."""


def check_widths(where: str, **widths: int) -> None:
    """Raise UserError for a width of a network that is less than 1, or so large that its size overflows.

    Examples:
        >>> check_widths("generator", channels=0)
        Traceback (most recent call last):
        ...
        unproject._types.UserError: generator: channels=0; give at least 1
    """
    for name, width in widths.items():
        if not 1 <= width <= MAX_WIDTH:
            raise UserError(f"{where}: {name}={width}; give at {'least 1' if width < 1 else f'most {MAX_WIDTH}'}")


def halved_widths(channels: int, levels: int, least: int = 8) -> list[int]:
    """Return the widths of so many levels after a first one of `channels`, each half of the one before.

    Examples:
        >>> halved_widths(32, 3)
        [32, 16, 8, 8]
    """
    return [channels, *(max(channels // 2**i, least) for i in range(1, levels + 1))]


def last_keeps_width(channels: int, levels: int, least: int = 8) -> bool:
    """Whether the last of several levels has as many channels as the one before, so that it may change nothing.

    Examples:
        >>> last_keeps_width(32, 3), last_keeps_width(128, 3)
        (True, False)
    """
    *_, before, last = halved_widths(channels, levels, least)
    return levels > 1 and before == last


def mapping(code_size: int, hidden: int) -> nn.Sequential:
    """Return the network that maps codes (B, L) to what modulates the levels, (B, hidden)."""
    return nn.Sequential(nn.Linear(code_size, hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, hidden), nn.LeakyReLU(0.2))


def upsampling_levels(size: int) -> int:
    """Return the number k of doublings from 4 to `size`. Raises UserError unless size is 4·2^k, k ≥ 1."""
    levels = round(math.log2(size / 4)) if size >= 8 else 0
    if levels < 1 or 4 * 2**levels != size:
        raise UserError(f"size {size}: generators double from 4, so choose 8, 16, 32, 64, 128 or 256")
    return levels


class SmoothUpsampling(nn.Module):
    """Upsampling of a vector (B, inputs) to (B, outputs, *shape), an image or a line, by `levels` doublings.

    Each level convolves (3 taps an axis), then interpolates linearly to the doubled size: smoother than a transposed
    convolution and cheaper, since the convolution is at the smaller size. Modulated batch norm and ReLU follow. A last
    convolution at full size allows edges sharper than the interpolation. Channels halve with every level, down to
    `outputs`: with fewer channels than that, thin parts are not resolved.
    """

    def __init__(self, inputs: int, channels: int, outputs: int, shape: tuple[int, ...], levels: int) -> None:
        super().__init__()
        dims = len(shape)
        convolution = nn.Conv2d if dims == 2 else nn.Conv1d
        widths = halved_widths(channels, levels, outputs)
        self.grows = last_keeps_width(channels, levels, outputs)
        self.shape = (channels, *[side // 2**levels for side in shape])
        self.start = nn.Linear(inputs, math.prod(self.shape))
        self.norms = nn.ModuleList([ModulatedNorm(inputs, width, dims) for width in widths])
        self.levels = nn.ModuleList(
            [convolution(a, b, 3, padding=1, bias=False) for a, b in zip(widths, widths[1:], strict=False)]
        )
        self.last = convolution(widths[-1], outputs, 3, padding=1)

    def forward(self, hidden: Tensor) -> Tensor:
        x = self.start(hidden).view(len(hidden), *self.shape)
        if x.dim() == 4:
            x = x.contiguous(memory_format=torch.channels_last)
        x = F.relu(self.norms[0](x, hidden))
        for convolution, norm in zip(self.levels, list(self.norms)[1:], strict=True):
            x = F.relu(norm(doubled(convolution(x)), hidden))
        return self.last(x)

    def last_level(self) -> set[str]:
        """Return the names of the weights of the last level."""
        prefixes = f"levels.{len(self.levels) - 1}.", f"norms.{len(self.norms) - 1}."
        return {name for name in self.state_dict() if name.startswith(prefixes)}

    @torch.no_grad()
    def pass_through(self, hidden: Tensor) -> None:
        """Let the last level give what it is given, interpolated, of vectors like these (B, inputs).

        Its convolution becomes the identity, and its norm restores the mean and deviation that it takes away.
        """
        seen: list[Tensor] = []
        norm = self.norms[-1]
        assert isinstance(norm, ModulatedNorm)
        nn.init.dirac_(self.levels[-1].get_parameter("weight"))
        with norm.register_forward_pre_hook(lambda module, given: seen.append(given[0])):
            self(hidden)
        norm.restore(seen[0])


class ModulatedNorm(nn.Module):
    """Batch norm whose scale and shift depend on a vector h: (1 + A h) * norm(x) + B h, channel by channel.

    With it the code enters at every level of a generator, not only at the first.

    References:
        de Vries et al. 2017, Modulating early visual processing by language (conditional batch norm).
    """

    def __init__(self, inputs: int, channels: int, dims: int) -> None:
        super().__init__()
        self.norm = (nn.BatchNorm2d if dims == 2 else nn.BatchNorm1d)(channels)
        self.modulation = nn.Linear(inputs, 2 * channels)
        nn.init.normal_(self.modulation.weight, std=0.3 * inputs**-0.5)
        nn.init.zeros_(self.modulation.bias)

    def forward(self, x: Tensor, hidden: Tensor) -> Tensor:
        modulation = self.modulation(hidden).view(len(x), -1, *[1] * (x.dim() - 2))
        scale, shift = modulation.chunk(2, 1)
        return self.norm(x) * (1 + scale) + shift

    @torch.no_grad()
    def restore(self, x: Tensor) -> None:
        """Change nothing, of values with the statistics of x (B, C, ...)."""
        variance, mean = torch.var_mean(x.transpose(0, 1).flatten(1), 1)
        self.norm.running_mean, self.norm.running_var = mean, variance
        self.norm.weight.copy_((variance + self.norm.eps).sqrt())
        self.norm.bias.copy_(mean)
        nn.init.zeros_(self.modulation.weight)
        nn.init.zeros_(self.modulation.bias)


class ModulatedScale(nn.Module):
    """RMS norm whose scale and shift depend on a vector h: (1 + A h) x / rms(x) + B h, channel by channel.

    The root mean square is over all channels and places of one sample: samples do not depend on their batch, and the
    ratios between channels and between places are kept.

    References:
        Zhang & Sennrich 2019, Root mean square layer normalization.
    """

    def __init__(self, inputs: int, channels: int) -> None:
        super().__init__()
        self.modulation = nn.Linear(inputs, 2 * channels)
        nn.init.normal_(self.modulation.weight, std=0.3 * inputs**-0.5)
        nn.init.zeros_(self.modulation.bias)

    def forward(self, x: Tensor, hidden: Tensor) -> Tensor:
        scale, shift = self.modulation(hidden).view(len(x), -1, *[1] * (x.dim() - 2)).chunk(2, 1)
        size = (x.square().mean(tuple(range(1, x.dim())), keepdim=True) + 1e-6).rsqrt()
        return x * (size * (1 + scale)) + shift


class HeadConv(nn.Module):
    """A stride-2 convolution, 4 wide, with separate weights for each head; sample b uses those of head[b].

    Samples are gathered by head into equal padded groups, so the cost is that of the largest group times the number of
    heads in use, not that of all heads for all samples.

    Args:
        heads: number of heads.
        inputs, outputs: channels.
        dims: 2 for images (B, C, H, W), 1 for lines (B, C, W).
    """

    def __init__(self, heads: int, inputs: int, outputs: int, dims: int = 2) -> None:
        super().__init__()
        taps = inputs * 4**dims
        bound = 1 / math.sqrt(taps)
        self.weight = nn.Parameter(torch.empty(heads, outputs, taps).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(heads, outputs).uniform_(-bound, bound))

    def forward(self, x: Tensor, head: Tensor) -> Tensor:
        if x.dim() == 3:
            columns = F.unfold(x[:, :, None], (1, 4), padding=(0, 1), stride=(1, 2))
        else:
            columns = F.unfold(x, 4, padding=1, stride=2)
        y = grouped_linear(columns.transpose(1, 2), self.weight, self.bias, head)  # (B, positions, outputs)
        return y.transpose(1, 2).unflatten(2, [side // 2 for side in x.shape[2:]])


def grouped_linear(x: Tensor, weight: Tensor, bias: Tensor, head: Tensor) -> Tensor:
    """Compute y[b] = x[b] W[head[b]]ᵀ + c[head[b]] for x (B, P, I), W (H, O, I), c (H, O), as one batched product."""
    used, group = head.unique(return_inverse=True)
    order = group.argsort(stable=True)
    sizes = torch.bincount(group, minlength=len(used))
    rank = torch.arange(len(head), device=head.device) - (sizes.cumsum(0) - sizes)[group[order]]
    place = torch.empty_like(order)
    largest = int(sizes.max())
    place[order] = group[order] * largest + rank
    padded = x.new_zeros(len(used) * largest, *x.shape[1:]).index_copy(0, place, x)
    padded = padded.view(len(used), -1, x.shape[-1])
    y = torch.baddbmm(bias[used][:, None], padded, weight[used].transpose(1, 2))
    return y.view(len(used) * largest, x.shape[1], -1)[place]


def inscribed_disc(size: int) -> Tensor:
    """Return (size, size) 1 where a pixel's centre lies within size / 2 of the middle, 0 elsewhere.

    Examples:
        >>> inscribed_disc(4).int().tolist()
        [[0, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [0, 1, 1, 0]]
    """
    place = torch.arange(size) - (size - 1) / 2
    return (place.square()[:, None] + place.square() <= (size / 2) ** 2).float()


def volume_norm(channels: int, batch_statistics: bool) -> nn.BatchNorm3d:
    """Return a batch norm of volumes, without running statistics if those of the batch count always."""
    return nn.BatchNorm3d(channels, track_running_stats=not batch_statistics)


def volume_doubling(before: int, after: int, upsampling: Upsampling) -> nn.Module:
    """Return a layer from volumes of `before` channels to those of `after` that are twice as large a side."""
    if upsampling == "transposed":
        return nn.ConvTranspose3d(before, after, 4, 2, 1)
    if upsampling == "nearest":
        return nn.Sequential(nn.Upsample(scale_factor=2), nn.Conv3d(before, after, 3, padding=1))
    raise UserError(f"upsampling={upsampling!r}: choose 'transposed' or 'nearest'")
