"""LowRankGenerator: volumes as sums of products of planes and lines."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn

from .._types import UserError
from ..ops.limits import limited, penalised
from ..ops.refinement import refined
from .blocks import SmoothUpsampling, check_widths, mapping, upsampling_levels
from .generators import Generator, reflect

FARTHEST, PENALTY = 3.0, 0.01
"""Where the penalty of t begins, over c, and its weight."""
MEASURED = 256
"""Codes whose features a new level is adjusted to."""


class LowRankGenerator(Generator):
    """Volumes as sums of plane × line products, for CPUs and for large volumes.

    t[x, y, z] = b + r^-½ Σ_r (P_xy[r] L_z[r] + P_yz[r] L_x[r] + P_xz[r] L_y[r]) and p = sigmoid(t / √(1 + (t / c)²)).
    Planes come from 2-D and lines from 1-D convolutions, so the cost grows with size² rather than size³. All upsampling
    is smooth: transposed convolutions leave a checkerboard in the factors, which makes volumes striped inside while
    their silhouettes are right.

    Logits are within ±c, and the gradient holds that of 0.01 E max(|t| - 3 c, 0)² too (`ops.penalised`). Otherwise t
    grows without end, to some ten thousand: where a sigmoid has no gradient, a part that is missing stays missing, and
    volumes may become empty for good.

    `sample(size=...)` takes a multiple of the size: planes and lines are refined (`ops.refined`), then multiplied.
    Averages of planes and lines are kept, and with them those of t, since each product has its plane and its line along
    different axes. Probabilities, over the fine voxels of a coarse one, then average to p within 0.049 times the
    variance of t (half the largest |p''| for c = 10).

    Args:
        size: side of the volume, 4·2^k.
        code_size: length of a code.
        channels: at 4.
        rank: r, the number of products per axis.
        mirror: generate the half with x < 0 only and reflect it, at two thirds of the cost (True or "x"), or the half
            with z < 0 ("z").
        bias: initial b; negative, so that training starts from nearly transparent volumes: in opaque ones every ray is
            saturated and has no gradient.
        limit: c.
        truncation, hull: see `Generator`.

    References:
        Chen et al. 2022, TensoRF (the vector-matrix decomposition).

    Examples:
        >>> import torch, unproject as up
        >>> generator = up.networks.LowRankGenerator(size=16, code_size=8, channels=16, rank=4)
        >>> generator.sample(3, seed=0).shape
        torch.Size([3, 16, 16, 16])
    """

    domain = "volumes"
    replayable = True
    limit: Tensor

    def __init__(
        self,
        size: int = 32,
        code_size: int = 128,
        channels: int = 128,
        rank: int = 32,
        mirror: bool | Literal["x", "z"] = False,
        bias: float = -5.0,
        limit: float = 10.0,
        truncation: float | None = None,
        hull: bool | float = False,
    ) -> None:
        check_widths("LowRankGenerator", size=size, code_size=code_size, channels=channels, rank=rank)
        super().__init__(code_size, truncation, hull)
        hidden = 256
        if mirror not in (False, True, "x", "z"):
            raise UserError(f"LowRankGenerator(mirror={mirror!r}): give False, True, 'x' or 'z'")
        self.mirror: str = "x" if mirror is True else mirror or ""
        if not limit > 0:
            raise UserError(f"LowRankGenerator(limit={limit:g}): must be positive")
        self.size = size
        self.scale = rank**-0.5
        self.mapping = mapping(code_size, hidden)
        levels = upsampling_levels(size)
        x, z = (size // 2 if self.mirror == axis else size for axis in "xz")
        planes, lines = ((x, z), (z, size), (x, size)), ((size,), (x,), (z,))
        self.planes = nn.ModuleList([SmoothUpsampling(hidden, channels, rank, shape, levels) for shape in planes])
        self.lines = nn.ModuleList([SmoothUpsampling(hidden, channels, rank, shape, levels) for shape in lines])
        self.bias = nn.Parameter(torch.tensor(float(bias)))
        # Stored: weights keep their limit, and those of before there was one are refused rather than misread.
        self.register_buffer("limit", torch.tensor(float(limit)))

    def logits(self, hidden: Tensor, times: int = 1) -> Tensor:
        """Return the logits of occupancy, (B, X, Y, Z), or of one half with `mirror`, on a grid `times` as fine."""
        return limited(penalised(self.sums(hidden, times), FARTHEST * self.limit, PENALTY), self.limit)

    def sums(self, hidden: Tensor, times: int = 1) -> Tensor:
        """Return t, from which the logits come, of what the mapping network makes of codes."""
        # Beyond its last cell a half is constant, which is its mirror image there: it is refined as the whole would be.
        xz, zy, xy = (refined(refined(plane(hidden), times, -1), times, -2) for plane in self.planes)
        along_y, along_x, along_z = (refined(line(hidden), times, -1) for line in self.lines)
        # Summed as (B, X, Z, Y): silhouettes at elevation 0 read columns, which are contiguous then.
        total = torch.bmm(xz.flatten(2).transpose(1, 2), along_y).unflatten(1, xz.shape[2:])
        total = total + torch.bmm(along_x.transpose(1, 2), zy.flatten(2)).unflatten(2, zy.shape[2:])
        total = total + along_z.transpose(1, 2)[:, None] @ xy.transpose(1, 2)
        return (total * self.scale + self.bias).transpose(2, 3)

    def grow(self, weights: dict[str, Tensor]) -> None:
        """Take over the weights of a generator of half the size; the last level of each plane and line is new.

        It gives what it is given, interpolated, so that volumes are about the refined ones (`at_size`).

        Raises:
            UserError: if weights of another level are missing, too many or of another shape, or the last level has
                fewer channels than the one before (of a quarter of `channels` at the most, `rank` at the least).
        """
        own = self.state_dict()
        factors = [(f"{name}.{i}.", part) for name in ("planes", "lines") for i, part in enumerate(getattr(self, name))]
        if not all(factor.grows for _, factor in factors):
            raise UserError("the last level has fewer channels than the one before: lower channels, or raise rank")
        new = {prefix + name for prefix, factor in factors for name in factor.last_level()}
        shapes = {name: value.shape for name, value in own.items() if name not in new}
        if shapes != {name: value.shape for name, value in weights.items()}:
            raise UserError(f"the weights are of no generator of {self.size // 2} voxels a side, alike in all else")
        self.load_state_dict(own | weights)
        training = self.training
        self.eval()
        hidden = self.mapping(self.codes(MEASURED).to(self.bias.device))
        for _, factor in factors:
            factor.pass_through(hidden.detach())
        self.train(training)

    def map_code(self, code: Tensor) -> Tensor:
        return self.mapping(code)

    def synthesise(self, latent: Tensor) -> Tensor:
        return self._volumes(latent, 1)

    def forward(self, code: Tensor) -> Tensor:
        return self.synthesise(self.mapping(code))

    def at_size(self, code: Tensor, size: int) -> Tensor:
        """Return volumes of `size` a side, a multiple of the generator's own, by refining planes and lines."""
        if size < self.size or size % self.size:
            raise UserError(f"size {size}: choose {self.size}, or a multiple of it such as {2 * self.size}")
        return self._volumes(self.mapping(code), size // self.size)

    def _volumes(self, hidden: Tensor, times: int) -> Tensor:
        x = torch.sigmoid(self.logits(hidden, times))
        return reflect(x, "xyz".index(self.mirror) + 1) if self.mirror else x
