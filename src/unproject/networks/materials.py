"""Generators of materials: four maps (B, 8, H, W) from one code, by branches that share their first levels.

    k_d = s_d σ(a),  k_s = s_s σ(b),  m = s_m σ(c),  n = (2σ(d₁) - 1, 2σ(d₂) - 1, σ(d₃)) / |…|

with a scale factor s of each albedo and of the roughness for the whole material: what differs most between materials is
said once, and the maps keep to their own variation. The normal's z is positive, so no normal points into the surface.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..ops.maps import MAPS, pack_maps
from .blocks import ModulatedNorm, upsampling_levels
from .generators import Generator

SCALED = ("diffuse", "specular", "roughness")
LEAST_Z = 0.05
LEAST_ROUGHNESS = 5e-3


class MaterialGenerator(Generator):
    """What both have in common: maps from four branches' outputs and three scale factors."""

    def __init__(self, code_size: int, truncation: float | None = None) -> None:
        super().__init__(code_size, truncation)
        self.scales = nn.Linear(code_size, len(SCALED))
        nn.init.normal_(self.scales.weight, std=0.1 * code_size**-0.5)
        nn.init.constant_(self.scales.bias, 0.5413)  # softplus of it is 1

    def maps(self, code: Tensor, drawn: dict[str, Tensor]) -> Tensor:
        """Maps (B, 8, H, W) of what the branches drew, before their sigmoids."""
        scale = F.softplus(self.scales(code))[:, :, None, None, None]
        named = {name: torch.sigmoid(values.float()) for name, values in drawn.items()}
        for k, name in enumerate(SCALED):
            named[name] = named[name] * scale[:, k]
        named["roughness"] = named["roughness"] + LEAST_ROUGHNESS
        n = named["normal"]
        n = torch.cat([2 * n[:, :2] - 1, n[:, 2:] + LEAST_Z], 1)
        named["normal"] = n / n.square().sum(1, keepdim=True).sqrt()
        return pack_maps(named)


class DCGANMaterials(MaterialGenerator):
    """The seed's: DCGAN levels, batch norm and LeakyReLU, a sigmoid at the end, codes z ~ U(-1, 1)⁵¹².

    Args:
        size: side of the maps, 4·2^k.
        channels: at 4²; halved with every level.
        shared: layers that the branches share, the linear one among them.

    References:
        Li et al. 2019, supplemental, section 2.2 and Fig. 6; Radford et al. 2016.
    """

    def __init__(
        self, size: int = 64, code_size: int = 512, channels: int = 512, shared: int = 2, slope: float = 0.2
    ) -> None:
        super().__init__(code_size)
        widths = [max(channels // 2**i, 8) for i in range(upsampling_levels(size) + 1)]
        self.width, self.slope = channels, slope
        self.start = nn.Linear(code_size, channels * 4**2)
        # The code's layer is the first of those shared.
        common = [nn.BatchNorm2d(channels), nn.LeakyReLU(slope)]
        pairs = list(zip(widths, widths[1:], strict=False))
        shared = min(shared, len(pairs))
        for before, after in pairs[: shared - 1]:
            common += self._level(before, after)
        self.common = nn.Sequential(*common)
        self.branches = nn.ModuleDict({name: self._branch(pairs[shared - 1 :], place) for name, place in MAPS.items()})

    def _level(self, before: int, after: int) -> list[nn.Module]:
        return [nn.ConvTranspose2d(before, after, 4, 2, 1), nn.BatchNorm2d(after), nn.LeakyReLU(self.slope)]

    def _branch(self, pairs: list[tuple[int, int]], place: slice) -> nn.Sequential:
        levels = [layer for before, after in pairs for layer in self._level(before, after)]
        last = nn.Conv2d(pairs[-1][1], place.stop - place.start, 3, padding=1)
        return nn.Sequential(*levels, last)

    def draw(self, n: int, rng: torch.Generator) -> Tensor:
        """n codes z ~ U(-1, 1)."""
        return torch.rand(n, self.code_size, generator=rng) * 2 - 1

    def forward(self, code: Tensor) -> Tensor:
        x = self.common(self.start(code).view(len(code), self.width, 4, 4))
        return self.maps(code, {name: branch(x) for name, branch in self.branches.items()})


class SmoothMaterials(MaterialGenerator):
    """A modern one: the code is heard at every level, upsampling is smooth, and each level adds noise of its own.

    A mapping of the code scales and shifts every normalised level. Texture that no two materials share, where a fibre
    lies, comes from a map of noise a level, drawn from the code itself, so that the same code gives the same material.

    Args:
        size: side of the maps, 4·2^k.
        channels: at 4²; halved with every level, to `least` at least.
        shared: levels that the branches share; each has one of its own at least.

    References:
        Karras et al. 2019 (a mapping network, noise at every level); de Vries et al. 2017 (modulated norms).
    """

    def __init__(
        self, size: int = 64, code_size: int = 128, channels: int = 256, shared: int = 3, least: int = 24
    ) -> None:
        super().__init__(code_size)
        levels, hidden = upsampling_levels(size), 256
        shared = min(shared, levels - 1)
        widths = [max(channels // 2**i, least) for i in range(levels + 1)]
        self.mapping = nn.Sequential(
            nn.Linear(code_size, hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, hidden), nn.LeakyReLU(0.2)
        )
        self.start = nn.Linear(hidden, widths[0] * 4**2)
        self.width = widths[0]
        pairs = list(zip(widths, widths[1:], strict=False))
        self.first = ModulatedNorm(hidden, widths[0], 2)
        self.common = nn.ModuleList([SmoothLevel(hidden, a, b) for a, b in pairs[:shared]])
        self.branches = nn.ModuleDict({name: self._branch(hidden, pairs[shared:], s) for name, s in MAPS.items()})

    def _branch(self, hidden: int, pairs: list[tuple[int, int]], place: slice) -> nn.ModuleList:
        last = nn.Conv2d(pairs[-1][1], place.stop - place.start, 3, padding=1)
        return nn.ModuleList([*[SmoothLevel(hidden, a, b) for a, b in pairs], last])

    def forward(self, code: Tensor) -> Tensor:
        hidden = self.mapping(code)
        x = self.start(hidden).view(len(code), self.width, 4, 4)
        x = F.relu(self.first(x.contiguous(memory_format=torch.channels_last), hidden))
        for level in self.common:
            x = level(x, hidden, code)
        drawn = {}
        for name, branch in self.branches.items():
            y = x
            for level in list(branch)[:-1]:  # pyright: ignore[reportArgumentType]
                y = level(y, hidden, code)
            drawn[name] = branch[-1](y).contiguous()  # pyright: ignore[reportIndexIssue]
        return self.maps(code, drawn)


class SmoothLevel(nn.Module):
    """Convolution, bilinear doubling, noise, modulated batch norm, ReLU."""

    def __init__(self, hidden: int, before: int, after: int) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, 3, padding=1, bias=False)
        self.norm = ModulatedNorm(hidden, after, 2)
        self.strength = nn.Parameter(torch.full((after,), 0.1))

    def forward(self, x: Tensor, hidden: Tensor, code: Tensor) -> Tensor:
        x = F.interpolate(self.convolution(x), scale_factor=2, mode="bilinear", align_corners=False)
        x = x + self.strength[:, None, None] * noise_of(code, x.shape[2])
        return F.relu(self.norm(x, hidden))


def noise_of(code: Tensor, size: int) -> Tensor:
    """(B, 1, size, size), nearly N(0, 1) and nearly white: a function of the code, so that samples repeat.

    frac(sin) of the pixel's number and the code, as shaders draw noise, brought to mean 0 and deviation 1.
    """
    seed = code.detach().double()[:, :2].sum(1) * 1e3
    pixel = torch.arange(size * size, dtype=torch.float64, device=code.device)
    raw = torch.frac(torch.sin((pixel + 1) * 12.9898 + seed[:, None] * 78.233).abs() * 43758.5453)
    return ((raw - 0.5) * 12**0.5).to(code.dtype).view(-1, 1, size, size)
