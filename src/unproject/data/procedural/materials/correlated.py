"""Materials correlated by design inside (diffuse, normal) and inside (specular, roughness), and not across.

Four fields are read off the maps: the luminance Y of k_d; the height h with slopes nearest to the normals'; k_s; m.

    h:  p = -n_x/n_z, q = -n_y/n_z,   ĥ(f) = -i (f_x p̂ + f_y q̂) / (2π |f|²)

The statistic, `octave_correlations`, is their Pearson correlation over the texels of one material and one octave of
frequencies: both fields cut to 2^o <= |f| < 2^(o+1) cycles a tile, for o = 0, 1, … while 2^o is below half the size,
and below 64. It takes nothing but the maps, so what a generator makes is scored the same way: average over materials,
and read it octave by octave.

Here it equals `diffuse_normal` between Y and h, `specular_roughness` between k_s and m, and 0 between either of one
group and either of the other: in every octave of every material, up to rounding, so also in whatever mean of them is
taken. Four fields of noise are made orthonormal in each octave (by the inverse of Cholesky's factor), e₁ … e₄, and
weighted by a spectrum |f|^-slope, one for each group:

    Y ~ e₁,   h ~ r e₁ + √(1 - r²) e₂,   k_s ~ e₃,   m ~ r' e₃ + √(1 - r'²) e₄

Every map is linear in its field, which deviates as much in every material as in the next (unless it would not fit), so
that the correlation over the texels of all materials at once, each less its own mean, is the same. What differs between
materials as wholes (mean colour, mean k_s and m, spectra) is drawn independently: means correlate by chance alone. No
direction; all tile.

k_s is 0.14 to 0.24 on average, more than dielectrics reflect, so that pictures show it.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...._types import UserError
from ....ops.exposure import linear_from_srgb
from ....ops.lengths import unit
from ....ops.maps import luminance, pack_maps, unpack_maps, with_specular
from ..span import Span
from .noise import FINEST, Chances, Draws

FIELDS = ("diffuse", "normal", "specular", "roughness")
SPREAD = {"diffuse": 0.055, "normal": 0.0045, "specular": 0.030, "roughness": 0.042}
"""Standard deviations of the four fields, the same in every material; the height's in widths of the tile."""
BRIGHTEST = 0.68  # of a mean colour's channels
SILENT = 1e-12  # variance below which an octave counts as empty

CHANCES = Chances(
    "correlated",
    {
        "coarse": Span(1.4, 2.2, "slope of the spectrum of diffuse and height"),
        "even": Span(0.9, 2.0, "slope of the spectrum of specular and roughness"),
        "light": Span(0.30, 0.50, "mean of Y"),
        "specular": Span(0.14, 0.24, "mean of k_s"),
        "roughness": Span(0.20, 0.36, "mean of m"),
    },
    {"colour": 3, "shade": 3},
    FIELDS,
)


def build_correlated(d: Draws, diffuse_normal: float, specular_roughness: float) -> Tensor:
    """Maps (B, 8, S, S) of drawn materials.

    Raises:
        UserError: for a correlation that is not within [-1, 1].
    """
    for name, r in (("diffuse_normal", diffuse_normal), ("specular_roughness", specular_roughness)):
        if not -1 <= r <= 1:
            raise UserError(f"correlated: {name} is a correlation; give a number from -1 to 1, not {r:g}")
    light, height, shine, dull = correlated_fields(d, diffuse_normal, specular_roughness).unbind(1)
    mean, shade = _colours(d)
    maps = {
        "diffuse": _swung(mean, shade, light[:, None]),
        "specular": _swung(d["specular"][:, None], torch.tensor(SPREAD["specular"]), shine[:, None]),
        "roughness": _swung(d["roughness"][:, None], torch.tensor(SPREAD["roughness"]), dull[:, None]),
        "normal": _normals(SPREAD["normal"] * height),
    }
    return pack_maps({name: x.float() for name, x in maps.items()})


def octave_correlations(maps: Tensor) -> Tensor:
    """The statistic above of maps (N, 8 or 10, S, S): (N, octaves, 4, 4), rows and columns in the order of `FIELDS`.

    0 where a field has nothing in an octave.
    """
    parts = unpack_maps(with_specular(maps.double(), 1))
    fields = torch.stack(
        [
            luminance(parts["diffuse"])[:, 0],
            _height(parts["normal"]),
            parts["specular"][:, 0],
            parts["roughness"][:, 0],
        ],
        1,
    )
    by_octave = _octaves(torch.fft.rfft2(fields), maps.shape[-1]).flatten(3)
    covariance = by_octave @ by_octave.mT / by_octave.shape[-1]
    variance = covariance.diagonal(dim1=-2, dim2=-1)
    scale = torch.where(variance > SILENT, variance, torch.inf).rsqrt()
    return covariance * scale[..., None] * scale[..., None, :]


def correlated_fields(d: Draws, diffuse_normal: float, specular_roughness: float) -> Tensor:
    """(B, 4, S, S) in double, of variance 1, with the correlations asked for in every octave."""
    noise = torch.stack([d.clouds(name, slope) for name, slope in _slopes(d)], 1).double()
    bands = _octaves(torch.fft.rfft2(noise), d.size)
    energy = bands.square().mean((3, 4))
    share = energy / energy.sum(1, keepdim=True)
    share = torch.stack([share[:, :, k] for k in (0, 0, 2, 2)], 2)[..., None, None]
    e = _orthonormal(bands)
    mixed = [e[:, :, 0], _mixed(diffuse_normal, e[:, :, 0], e[:, :, 1])]
    mixed += [e[:, :, 2], _mixed(specular_roughness, e[:, :, 2], e[:, :, 3])]
    return (share.sqrt() * torch.stack(mixed, 2)).sum(1)


def _slopes(d: Draws) -> list[tuple[str, Tensor]]:
    return [(name, d["coarse" if k < 2 else "even"]) for k, name in enumerate(FIELDS)]


def _mixed(r: float, a: Tensor, b: Tensor) -> Tensor:
    return r * a + math.sqrt(1 - r * r) * b


def _octaves(c: Tensor, size: int) -> Tensor:
    """Fields (B, octaves, 4, S, S) of their Fourier coefficients (B, 4, S, S/2 + 1), an octave at a time."""
    f_x, f_y = _frequencies(size)
    f = torch.hypot(f_x, f_y)
    highest = min(size, FINEST) / 2
    cut = [(f >= 2**o) & (f < min(2 ** (o + 1), highest)) for o in range(math.ceil(math.log2(highest)))]
    return torch.fft.irfft2(torch.stack(cut)[:, None] * c[:, None], s=(size, size))


def _orthonormal(x: Tensor) -> Tensor:
    """x (..., 4, S, S) with variance 1 and no correlation among the four."""
    flat = x.flatten(-2)
    factor = torch.linalg.cholesky(flat @ flat.mT / flat.shape[-1])
    return torch.linalg.solve_triangular(factor, flat, upper=False).view_as(x)


def _frequencies(size: int) -> tuple[Tensor, Tensor]:
    """f_x (1, S/2 + 1) and f_y (S, 1) in cycles a tile; y goes up, against the rows."""
    f_x = torch.arange(size // 2 + 1, dtype=torch.float64)[None]
    return f_x, -torch.fft.fftfreq(size, 1 / size, dtype=torch.float64)[:, None]


def _colours(d: Draws) -> tuple[Tensor, Tensor]:
    """The mean colour (B, 3, 1, 1), of luminance `light`, and the colour of the deviations from it."""
    light = d["light"][:, None]
    colour = linear_from_srgb(0.2 + 0.6 * d.table("colour"))[:, :, None, None]
    colour = colour * (light / luminance(colour))
    pale = ((BRIGHTEST - light) / (colour.amax(1, keepdim=True) - light).clamp(min=1e-6)).clamp(max=1)
    mean = torch.lerp(light.expand_as(colour), colour, pale.expand_as(colour))
    shade = mean * (0.7 + 0.6 * d.table("shade"))[:, :, None, None]
    return mean, shade * (SPREAD["diffuse"] / luminance(shade))


def _swung(mean: Tensor, deviation: Tensor, field: Tensor) -> Tensor:
    """mean + field · deviation, less of it where it would leave [mean / 8, 0.95] anywhere on the tile."""
    down = 0.875 * mean / (deviation * -field.amin((2, 3), keepdim=True))
    up = (0.95 - mean) / (deviation * field.amax((2, 3), keepdim=True))
    fits = torch.minimum(down, up).amin(1, keepdim=True).clamp(max=1)
    return mean + fits * deviation * field


def _normals(height: Tensor) -> Tensor:
    """Unit normals of a height, by its exact slopes."""
    size = height.shape[-1]
    f_x, f_y = _frequencies(size)
    c = torch.fft.rfft2(height)
    h_x, h_y = (torch.fft.irfft2(2j * math.pi * f * c, s=(size, size)) for f in (f_x, f_y))
    return unit(torch.stack([-h_x, -h_y, torch.ones_like(h_x)], 1), 1)


def _height(n: Tensor) -> Tensor:
    """The height (B, S, S) whose slopes are nearest to those of normals (B, 3, S, S), of mean 0."""
    size = n.shape[-1]
    f_x, f_y = _frequencies(size)
    p, q = torch.fft.rfft2(-n[:, :2] / n[:, 2:].clamp(min=1e-3)).unbind(1)
    square = (f_x**2 + f_y**2).clamp(min=1)
    return torch.fft.irfft2(-1j * (f_x * p + f_y * q) / (2 * math.pi * square), s=(size, size))
