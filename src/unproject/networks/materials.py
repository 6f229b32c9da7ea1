"""Generators of materials: four maps (B, 8, H, W) from one code, by branches that share what comes before them.

    k_d = s_d σ(a),  k_s = s_s σ(b),  m = s_m σ(c)

with a scale factor s of each albedo and of the roughness for the whole material: what differs most between materials is
said once, and the maps keep to their own variation. Normals are drawn, n = (2σ(d₁) - 1, 2σ(d₂) - 1, σ(d₃)) / |…|, or
those of a height with a factor of its own. Their z is positive, so none points into the surface.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..ops.maps import MAPS, normals_of, pack_maps
from .blocks import ModulatedScale, upsampling_levels
from .generators import Generator

SCALED = ("diffuse", "specular", "roughness")
GRAIN = (*[(1, 0.0)] * 4, (1, 1.0), (2, 1.0), (1, 0.25), (2, 0.25))
"""Along which axis, and how far, each of eight sources of noise is stretched: down, across; to the end, a quarter."""
LEAST_Z = 0.05
LEAST_ROUGHNESS = 5e-3
START = 4  # places a side
EITHER_SIGN = 6.0  # makes scales of about 1 ± 1 of vectors as they are before training
RELIEF = 0.1  # texels of height that 1 stands for before training
FIRST = {"diffuse": (-0.8,) * 3, "specular": (-3.0,), "roughness": (-0.8,), "normal": (0.0,)}
"""Where modern training starts: a nearly flat dielectric, k_d and m = 0.31, k_s = 0.05."""


class MaterialGenerator(Generator):
    """What both have in common: maps from four branches' outputs and scale factors.

    Args:
        code_size: length of a code.
        vector: how many of its entries, the first ones, the scale factors hear; all unless given.
        relief: whether the last branch draws a height, which has a scale factor too; else normals.
    """

    domain = "maps"

    def __init__(self, code_size: int, vector: int | None = None, relief: bool = False) -> None:
        super().__init__(code_size)
        self.vector = vector or code_size
        self.relief = relief
        self.scales = nn.Linear(self.vector, len(SCALED) + int(relief))
        nn.init.normal_(self.scales.weight, std=0.1 * self.vector**-0.5)
        nn.init.constant_(self.scales.bias, 0.5413)  # softplus of it is 1

    def maps(self, vector: Tensor, drawn: dict[str, Tensor]) -> Tensor:
        """Maps (B, 8, H, W) of what the branches drew, before their sigmoids."""
        scale = F.softplus(self.scales(vector))[:, :, None, None, None]
        named = {name: torch.sigmoid(drawn[name].float()) * scale[:, k] for k, name in enumerate(SCALED)}
        named["roughness"] = named["roughness"] + LEAST_ROUGHNESS
        last = drawn["normal"].float()
        named["normal"] = normals_of((RELIEF * scale[:, -1] * last)[:, 0]) if self.relief else _normals(last)
        return pack_maps(named)


def _normals(drawn: Tensor) -> Tensor:
    n = torch.sigmoid(drawn)
    n = torch.cat([2 * n[:, :2] - 1, n[:, 2:] + LEAST_Z], 1)
    return n / n.square().sum(1, keepdim=True).sqrt()


class DCGANMaterials(MaterialGenerator):
    """The paper's: DCGAN levels, batch norm and LeakyReLU, a sigmoid at the end, codes z ~ U(-1, 1)⁵¹².

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


class StationaryMaterials(MaterialGenerator):
    """A modern one, whose materials have no origin: what they are comes from a vector, where things lie from noise.

    The code is a vector and a map of 4² places. Convolutions start from the map, which repeats itself: shifted by a
    place, it gives the same material, noise aside, shifted by a quarter of its width. All levels repeat themselves
    too, so materials tile. The vector scales and shifts every level, and each adds noise of its own, finer than the
    map and drawn from it: the same code gives the same material, and a moving vector a material that changes smoothly.
    A level mixes several independent sources of noise, so that maps may have nothing to do with one another; half of
    them are grain, stretched along a row or a column. The last doubling is a sub-pixel convolution to fields, what
    there is at each pixel, and each map is a function of the fields there and of the vector, no more: what causes one
    causes the others, and goes with it in the same way at all scales, so that what photographs tell of the coarse ones
    holds for the finest. Normals are those of a height: relief has the same phase as what it goes with, and no bump
    that cannot be. No level looks at other materials of the batch: one is the same in training as when it is sampled.

    Args:
        size: side of the maps, 4·2^k.
        code_size: of the vector.
        places: channels of the map of 4² places.
        channels: at 4²; halved with every level, to `least` at least.
        sources: of noise, a level.
        fields: channels at full size.

    References:
        Bergmann et al. 2017, Learning texture manifolds with the periodic spatial GAN (a map of noise to start from).
        Zhou et al. 2022, TileGen (levels that repeat themselves). Karras et al. 2019 (noise at every level).
        Shi et al. 2016 (sub-pixel convolution). Zhang & Sennrich 2019 (root-mean-square norm).
    """

    def __init__(
        self,
        size: int = 64,
        code_size: int = 64,
        places: int = 8,
        channels: int = 128,
        sources: int = 8,
        fields: int = 16,
        least: int = 48,
    ) -> None:
        super().__init__(code_size + places * START**2, vector=code_size, relief=True)
        levels, hidden = upsampling_levels(size) - 1, 128
        self.mapping = nn.Sequential(
            nn.Linear(code_size, hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, hidden), nn.LeakyReLU(0.2)
        )
        widths = [channels, *[max(channels // 2 ** (i + 1), least) for i in range(levels)]]
        self.start = nn.Conv2d(places, channels, 3, bias=False)
        self.first = ModulatedScale(hidden, channels)
        self.common = nn.ModuleList([TilingLevel(hidden, a, b, sources) for a, b in zip(widths, widths[1:])])
        self.last = nn.Conv2d(widths[-1], 4 * fields, 3)
        self.strength = nn.Parameter(torch.randn(fields, sources) * 0.2 * sources**-0.5)
        self.branches = nn.ModuleDict({name: Pixelwise(hidden, fields, FIRST[name]) for name in MAPS})

    def forward(self, code: Tensor) -> Tensor:
        vector, places = code[:, : self.vector], code[:, self.vector :]
        hidden = self.mapping(vector)
        start = places.view(len(code), -1, START, START)
        x = self.start(tiled(start, 1).contiguous(memory_format=torch.channels_last))
        x = F.relu(self.first(x, hidden))
        noise: dict[int, Tensor] = {}
        for level in self.common:
            x = level(x, hidden, places, noise)
        fields = F.pixel_shuffle(without_lattice(self.last(tiled(x, 1))), 2)
        finest = noise_of(places, fields.shape[2], self.strength.shape[1])
        fields = fields + F.conv2d(finest, self.strength[:, :, None, None])
        return self.maps(vector, {name: branch(fields, hidden) for name, branch in self.branches.items()})


class Pixelwise(nn.Module):
    """Fields (B, C, H, W) to a map of them, pixel by pixel: a perceptron of two layers, modulated by the vector.

    At the start a field's share in a map has either sign, as the vector has it: materials whose gloss goes with their
    colour and such whose gloss goes against it. Which are true photographs tell, and the vectors follow. A sign that
    all materials had at once would have to be given up by all of them through maps with no contrast, which no
    discriminator lets pass.

    Args:
        hidden: length of what the vector became.
        fields: C.
        first: the map's channels where the perceptron says nothing.
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

    def forward(self, fields: Tensor, hidden: Tensor) -> Tensor:
        return self.last(F.leaky_relu(self.norm(self.mix(fields), hidden), 0.2)).contiguous()


class TilingLevel(nn.Module):
    """Convolution, bilinear doubling, noise, modulated scale, ReLU; what leaves on the left enters on the right."""

    def __init__(self, hidden: int, before: int, after: int, sources: int) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, 3, bias=False)
        self.norm = ModulatedScale(hidden, after)
        self.strength = nn.Parameter(torch.randn(after, sources) * 0.2 * sources**-0.5)

    def forward(self, x: Tensor, hidden: Tensor, places: Tensor, noise: dict[int, Tensor]) -> Tensor:
        size = 2 * x.shape[2]
        if size not in noise:
            noise[size] = noise_of(places, size, self.strength.shape[1])
        # One column more on every side than the convolution takes, for the interpolation; then cut off.
        x = F.interpolate(self.convolution(tiled(x, 2)), scale_factor=2, mode="bilinear", align_corners=False)
        x = x[:, :, 2:-2, 2:-2] + F.conv2d(noise[size], self.strength[:, :, None, None])
        return F.relu(self.norm(x, hidden))


def without_lattice(x: Tensor) -> Tensor:
    """(B, 4 C, H, W) for a sub-pixel shuffle, the means over places of each four that make one channel made equal.

    Else a constant difference of neighbours is easily learned, and seen as a lattice over the whole picture.
    """
    mean = x.mean((2, 3), keepdim=True)
    each = mean.view(len(x), -1, 4, 1, 1)
    return x - (each - each.mean(2, keepdim=True)).view_as(mean)


def tiled(x: Tensor, border: int) -> Tensor:
    """x with a border of its own repetition."""
    return F.pad(x, (border,) * 4, mode="circular")


def noise_of(code: Tensor, size: int, sources: int = 1) -> Tensor:
    """(B, sources, size, size), nearly N(0, 1): a function of the code, so that samples repeat.

    frac(sin) of the pixel's number and the code, as shaders draw noise, brought to mean 0 and deviation 1. Of each
    eight sources the first four are nearly white; the others are `GRAIN`, which convolutions of three pixels could not
    make of white noise: grooves and the joints of boards, which go on from end to end, and fibres.
    """
    seed = code.detach().double()[:, :2].sum(1) * 1e3
    pixel = torch.arange(sources * size * size, dtype=torch.float64, device=code.device)
    raw = torch.frac(torch.sin((pixel + 1) * 12.9898 + seed[:, None] * 78.233).abs() * 43758.5453)
    white = ((raw - 0.5) * 12**0.5).to(code.dtype).view(-1, sources, size, size)
    return torch.stack([_stretched(x, *GRAIN[k % len(GRAIN)]) for k, x in enumerate(white.unbind(1))], 1)


def _stretched(x: Tensor, axis: int, share: float) -> Tensor:
    """White noise (B, S, S) averaged along an axis over so much of the side, of deviation 1 again."""
    if share == 1:
        return x.narrow(axis, 0, 1).expand_as(x)
    n = max(1, round(share * x.shape[axis]))
    return torch.stack([x.roll(k, axis) for k in range(n)]).sum(0) * n**-0.5
