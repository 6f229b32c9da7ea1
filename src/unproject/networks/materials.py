"""Generators of materials: four maps (B, 8, H, W) from one code, by branches after shared layers.

With three specular channels the maps are (B, 10, H, W): gold reflects red and blue differently.

    k_d = s_d σ(a),  k_s = s_s σ(b),  m = s_m σ(c)

with scale factors s of the albedos and of the roughness for the whole material, which represent most of the variation
between materials; the maps represent the variation within one. Normals are
n = (2σ(d₁) - 1, 2σ(d₂) - 1, σ(d₃) + 0.05) / |…|, or those of a height with a scale factor. Their z is positive.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._types import UserError
from ..ops.maps import normals_of, pack_maps
from .blocks import ModulatedScale, check_widths, halved_widths, mapping, upsampling_levels
from .generators import Generator
from .texture_layers import Pixelwise, TilingLevel, Waves, shares, tiled, without_lattice
from .texture_noise import normal_noise, stretched, white_noise

SCALED = ("diffuse", "specular", "roughness")
LEAST_Z = 0.05
LEAST_ROUGHNESS = 5e-3
START = 4  # places a side of the map in the code
RELIEF = 0.1  # texels of height for an output of 1 before training
FIRST = {"diffuse": -0.8, "specular": -3.0, "roughness": -0.8, "normal": 0.0}
"""Initial biases of the maps: a nearly flat dielectric, k_d and m = 0.31, k_s = 0.05."""


class MaterialGenerator(Generator):
    """The base class of generators of materials: maps from the outputs of four branches and scale factors.

    Args:
        code_size: length of a code.
        vector: number of leading entries of the code that determine the scale factors (default: all).
        relief: whether the last branch gives a height, with a scale factor, rather than normals.
        specular_channels: of the specular albedo: 1, or 3 if it is coloured.

    Raises:
        UserError: for another number of specular channels.
    """

    domain = "maps"

    def __init__(
        self, code_size: int, vector: int | None = None, relief: bool = False, specular_channels: int = 1
    ) -> None:
        if specular_channels not in (1, 3):
            raise UserError(f"specular_channels={specular_channels}: give 1, or 3 for a coloured specular albedo")
        super().__init__(code_size)
        self.vector = vector or code_size
        self.relief = relief
        self.outputs = {"diffuse": 3, "specular": specular_channels, "roughness": 1, "normal": 1 if relief else 3}
        self.scales = nn.Linear(self.vector, len(SCALED) + int(relief))
        nn.init.normal_(self.scales.weight, std=0.1 * self.vector**-0.5)
        nn.init.constant_(self.scales.bias, 0.5413)  # softplus of it is 1

    def maps(self, vector: Tensor, drawn: dict[str, Tensor]) -> Tensor:
        """Return maps (B, 8 or 10, H, W) of the outputs of the branches, before their sigmoids."""
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
    """The paper's generator: DCGAN levels, batch norm and LeakyReLU, a sigmoid at the end, codes z ~ U(-1, 1)⁵¹².

    Args:
        size: side of the maps, 4·2^k.
        code_size: length of a code.
        channels: at 4²; halved with every level.
        shared: number of layers before the branches, including the linear one.
        slope: of LeakyReLU.
        specular_channels: 1, or 3 for a coloured specular albedo.

    References:
        Li et al. 2019, supplemental, section 2.2 and Fig. 6; Radford et al. 2016.

    Examples:
        >>> import torch, unproject as up
        >>> up.networks.DCGANMaterials(size=16, code_size=16, channels=16).sample(2).shape
        torch.Size([2, 8, 16, 16])
    """

    replayable = True

    def __init__(
        self,
        size: int = 64,
        code_size: int = 512,
        channels: int = 512,
        shared: int = 2,
        slope: float = 0.2,
        specular_channels: int = 1,
    ) -> None:
        check_widths(type(self).__name__, code_size=code_size, channels=channels, shared=shared)
        super().__init__(code_size, specular_channels=specular_channels)
        widths = halved_widths(channels, upsampling_levels(size))
        self.width, self.slope = channels, slope
        self.start = nn.Linear(code_size, channels * 4**2)
        # The linear layer is the first of the shared ones.
        common = [nn.BatchNorm2d(channels), nn.LeakyReLU(slope)]
        pairs = list(zip(widths, widths[1:], strict=False))
        shared = min(shared, len(pairs))
        for before, after in pairs[: shared - 1]:
            common += self._level(before, after)
        self.common = nn.Sequential(*common)
        self.branches = nn.ModuleDict({name: self._branch(pairs[shared - 1 :], n) for name, n in self.outputs.items()})

    def _level(self, before: int, after: int) -> list[nn.Module]:
        return [nn.ConvTranspose2d(before, after, 4, 2, 1), nn.BatchNorm2d(after), nn.LeakyReLU(self.slope)]

    def _branch(self, pairs: list[tuple[int, int]], outputs: int) -> nn.Sequential:
        levels = [layer for before, after in pairs for layer in self._level(before, after)]
        last = nn.Conv2d(pairs[-1][1], outputs, 3, padding=1)
        return nn.Sequential(*levels, last)

    def draw(self, n: int, rng: torch.Generator) -> Tensor:
        """Draw n codes z ~ U(-1, 1), (n, code_size)."""
        return torch.rand(n, self.code_size, generator=rng) * 2 - 1

    def forward(self, code: Tensor) -> Tensor:
        x = self.common(self.start(code).view(len(code), self.width, 4, 4))
        return self.maps(code, {name: branch(x) for name, branch in self.branches.items()})


class StationaryMaterials(MaterialGenerator):
    """A generator of stationary, tileable materials: appearance from a vector, arrangement from noise.

    The code is a vector and a map of 4² places. Convolutions start from the map. All layers are periodic, so materials
    tile; a map shifted by one place gives, apart from noise, the same material shifted by a quarter of its side. The
    vector scales and shifts every level. Each level adds noise, drawn from the map, so that equal codes give equal
    materials and a material changes smoothly with the vector. A level mixes several independent sources of noise, so
    that maps need not be correlated; half of the sources are grain, stretched along a row or a column.

    Since nothing depends on where it is, samples of any multiple of the side can be made (`at_size`): the map has as
    many more places, and texels are as large as in training. Nothing repeats within, and the whole tiles.

    The last doubling is a sub-pixel convolution to fields. Each map is a function of the fields at its pixel and of the
    vector only, so that maps are correlated in the same way at all scales: what training images determine at coarse
    scales holds at fine ones. Normals are those of a height, hence integrable and in phase with correlated maps. No
    layer uses batch statistics: a sample is the same in training as in evaluation.

    Args:
        size: side of the maps, 4·2^k.
        code_size: length of the vector.
        places: channels of the map of 4² places.
        channels: at 4²; halved with every level, down to `least`.
        sources: sources of noise in each level.
        fields: channels at full size.
        least: see `channels`.
        specular_channels: 1, or 3 for a coloured specular albedo.
        cycles: of the shortest wave that is added to the fields, a side, at most half of `size` (default: no waves).

    References:
        Bergmann et al. 2017, Learning texture manifolds with the periodic spatial GAN (a map of noise to start from,
        waves whose cycles depend on a vector).
        Zhou et al. 2022, TileGen (levels that repeat themselves). Karras et al. 2019 (noise at every level).
        Shi et al. 2016 (sub-pixel convolution). Zhang & Sennrich 2019 (root-mean-square norm).

    Examples:
        >>> import torch, unproject as up
        >>> up.networks.StationaryMaterials(size=16, channels=16, least=8).sample(2).shape
        torch.Size([2, 8, 16, 16])
    """

    replayable = True

    def __init__(
        self,
        size: int = 64,
        code_size: int = 64,
        places: int = 8,
        channels: int = 128,
        sources: int = 8,
        fields: int = 16,
        least: int = 48,
        specular_channels: int = 1,
        cycles: int = 0,
    ) -> None:
        widths = {"code_size": code_size, "places": places, "channels": channels, "sources": sources, "fields": fields}
        check_widths(type(self).__name__, **widths, least=least)
        super().__init__(code_size + places * START**2, code_size, relief=True, specular_channels=specular_channels)
        levels, hidden = upsampling_levels(size) - 1, 128
        self.size, self.places = size, places
        self.mapping = mapping(code_size, hidden)
        widths = halved_widths(channels, levels, least)
        self.start = nn.Conv2d(places, channels, 3, bias=False)
        self.first = ModulatedScale(hidden, channels)
        self.common = nn.ModuleList([TilingLevel(hidden, a, b, sources) for a, b in zip(widths, widths[1:])])
        self.last = nn.Conv2d(widths[-1], 4 * fields, 3)
        self.strength = nn.Parameter(torch.randn(fields, sources) * 0.2 * sources**-0.5)
        self.noise_shapes = [(sources, START * 2**k) for k in range(1, levels + 2)]
        self.white = sum(sources * side**2 for sources, side in self.noise_shapes)
        self.branches = nn.ModuleDict(
            {name: Pixelwise(hidden, fields, (FIRST[name],) * n) for name, n in self.outputs.items()}
        )
        for branch, own in zip(self.branches.values(), shares(fields, len(self.branches)), strict=True):
            assert isinstance(branch, Pixelwise)
            branch.begin_with(own)
        if not 0 <= cycles <= size // 2:
            raise UserError(f"{type(self).__name__}: cycles={cycles}: give 0 to {size // 2}, half of the pixels a side")
        self.waves = Waves(hidden, fields, cycles) if cycles else None

    def forward(self, code: Tensor) -> Tensor:
        return self.synthesise(self.map_code(code))

    def map_code(self, code: Tensor) -> Tensor:
        """Return latents: the code, and the noise of each level, which fits to pictures then choose freely."""
        return torch.cat([code, *(noise.flatten(1) for noise in self._white(code, 1))], 1)

    def synthesise(self, latent: Tensor) -> Tensor:
        code, white = latent[:, : self.code_size], latent[:, self.code_size :]
        parts = white.split([sources * side**2 for sources, side in self.noise_shapes], 1)
        noise = [
            part.view(-1, sources, side, side) for part, (sources, side) in zip(parts, self.noise_shapes, strict=True)
        ]
        return self._maps(code[:, : self.vector], code[:, self.vector :].view(len(code), -1, START, START), noise)

    def at_size(self, code: Tensor, size: int) -> Tensor:
        """Return maps of `size` a side, a multiple of the generator's own; texels are as large as those of training.

        The vector is the code's, so that it is the same material. The map of places and the noise are drawn anew, from
        the code, in the larger number.
        """
        times = size // self.size
        if size < self.size or size % self.size:
            raise UserError(f"size {size}: choose {self.size}, or a multiple of it such as {4 * self.size}")
        if times == 1:
            return self(code)
        vector, given = code[:, : self.vector], code[:, self.vector :]
        # The last two numbers of the code are the seed, as the first two are that of the noise.
        places = normal_noise(given.flip(1), times * START, self.places)
        return self._maps(vector, places, self._white(code, times), times)

    def _white(self, code: Tensor, times: int) -> list[Tensor]:
        return [white_noise(code[:, self.vector :], times * side, sources) for sources, side in self.noise_shapes]

    def _maps(self, vector: Tensor, places: Tensor, white: list[Tensor], times: int = 1) -> Tensor:
        """Return the maps of a vector, a map of places and the white noise of each level."""
        noise = [stretched(part, times) for part in white]
        hidden = self.mapping(vector)
        x = self.start(tiled(places, 1).contiguous(memory_format=torch.channels_last))
        x = F.relu(self.first(x, hidden))
        for level, drawn in zip(self.common, noise[:-1], strict=True):
            x = level(x, hidden, drawn)
        fields = F.pixel_shuffle(without_lattice(self.last(tiled(x, 1))), 2)
        fields = fields + F.conv2d(noise[-1], self.strength[:, :, None, None])
        if self.waves is not None:
            fields = fields + self.waves(hidden, places, fields.shape[-1], times)
        return self.maps(vector, {name: branch(fields, hidden) for name, branch in self.branches.items()})
