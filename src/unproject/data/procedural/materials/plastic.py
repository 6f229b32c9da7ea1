"""Moulded plastics: one colour each, saturated more often than not, on a surface that the mould gave them.

The mould is smooth, spark-eroded (isotropic grain of one size, VDI 3400), leather (pebbles with creases between), or
embossed: ribs, dots, squares, pyramids, a weave, or rings. A plastic is a dielectric, k_s = ((n - 1)/(n + 1))² of an
index n between 1.45 and 1.6 everywhere; its roughness goes from a mirror to matt,

    m = m₀ · exp(wear · clouds + dull · creases)

the tops of a texture polished by hands, creases dull and a little darker for the dirt in them. Some are speckled. The
ribs run along x or y, nothing else has a direction. All tile.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ....ops.exposure import linear_from_srgb
from ....ops.maps import pack_maps
from ..span import Span
from .noise import Chances, Draws, by_kind
from .patterns import cells, normals, scratches, smooth, texels, wrapped

SIDE, SCRATCHES = 20, 12

CHANCES = Chances(
    "plastic",
    {
        "mould": Span(0, 12 - 1e-4, "index into `MOULDS`, smooth, eroded and leather twice or more"),
        "neutral": Span(0, 1, "white, grey or black if below 0.22"),
        "hue": Span(0, 1, "turns from red"),
        "saturation": Span(0.60, 1.0, "of the colour, in sRGB"),
        "value": Span(0.35, 0.95, "of the colour, in sRGB"),
        "index": Span(1.45, 1.60, "of refraction"),
        "roughness": Span(math.log(0.03), math.log(0.45), "log of m₀"),
        "wear": Span(0.02, 0.20, "standard deviation of log m from place to place"),
        "relief": Span(0.25, 1.0, "how deep the mould is, of the deepest it can be"),
        "count": Span(0, 1, "how many periods a pattern has"),
        "shape": Span(0, 1, "how wide its parts are"),
        "turned": Span(0, 1, "ribs run along y if above 0.5"),
        "dirt": Span(0.0, 0.35, "how much darker creases are"),
        "hits": Span(-1.0, 0.8, "how deep scratches are; none below 0"),
        "speckles": Span(-1.0, 0.12, "how much of the surface has another colour; none below 0"),
    },
    {"jitter": 2 * SIDE * SIDE, "scratch": 5 * SCRATCHES},
    ("grain", "clouds", "speckles"),
)


def build_plastic(d: Draws) -> Tensor:
    """Maps (B, 8, S, S) of drawn plastics."""
    height, crease = by_kind(d["mould"], MOULDS, d).unbind(1)
    scratch = d["hits"].clamp(min=0) * scratches(d.table("scratch"), d.size)
    colour = torch.lerp(colour_of(d), colour_of(d).flip(1) * 0.6, speckled(d)[:, None])
    diffuse = 0.9 * colour * (1 - d["dirt"] * crease)[:, None]
    specular = (((d["index"] - 1) / (d["index"] + 1)) ** 2).expand_as(height)
    worn = d["wear"] * d.clouds("clouds", 1.3) + 0.5 * crease + 0.8 * scratch
    roughness = (torch.exp(d["roughness"] + worn)).clamp(0.02, 0.8)
    maps = {"diffuse": diffuse, "specular": specular[:, None], "roughness": roughness[:, None]}
    return pack_maps({**maps, "normal": normals(height - 0.0015 * scratch)})


def colour_of(d: Draws) -> Tensor:
    """(B, 3, 1, 1) linear: of hue, saturation and value; neutral ones are black, grey or white by their value."""
    neutral = d["neutral"] < 0.22
    saturation = torch.where(neutral, 0.06 * d["saturation"], d["saturation"])
    value = torch.where(neutral, 0.12 + 0.82 * ((d["value"] - 0.35) / 0.6), d["value"])
    sector = torch.cat([(6 * d["hue"] + k) % 6 for k in (5, 3, 1)], 1)
    share = torch.minimum(sector, 4 - sector).clamp(0, 1)
    return linear_from_srgb(value * (1 - saturation * share))[..., None]


def speckled(d: Draws) -> Tensor:
    """Grains of regrind."""
    return smooth(3 * (d.grain("speckles", 16.0, 6.0) - 2.2 + 8 * d["speckles"])) * (d["speckles"] > 0)


def plain(d: Draws) -> Tensor:
    """Smooth: what waves the mould has are a hundred times longer than high."""
    waves = d.grain("grain", 2.0, 1.5)
    return torch.stack([0.0012 * d["relief"] * waves, 0 * waves], 1)


def eroded(d: Draws) -> Tensor:
    """Spark erosion: grain of one size."""
    centre = 11 + 15 * d["count"]
    grain = d.grain("grain", centre, 0.3 * centre)
    return torch.stack([0.03 * d["relief"] / centre * grain, smooth(-0.4 * grain)], 1)


def leather(d: Draws) -> Tensor:
    """Pebbles with creases between them."""
    n = (7 + 10 * d["count"]).floor()
    nearest, second = cells(n, 0.1 + 0.8 * d.table("jitter"), d.size)
    pebble = smooth((second - nearest) / (0.3 + 0.4 * d["shape"]))
    fine = d.grain("grain", 20.0, 6.0)
    return torch.stack([0.06 * d["relief"] / n * pebble + 0.0004 * fine, 1 - pebble], 1)


def ribs(d: Draws) -> Tensor:
    """Ribs with flanks."""
    x, y = texels(d.size)
    along = torch.where(d["turned"] > 0.5, x, y)
    n = (4 + 10 * d["count"]).floor()
    return _raised((wrapped(along * n).abs() - 0.15 - 0.2 * d["shape"]) / n, n, d)


def dots(d: Draws) -> Tensor:
    """Round domes, staggered."""
    u, v, n = _places(d, staggered=True)
    radius = 0.24 + 0.16 * d["shape"]
    dome = (1 - (u**2 + v**2) / radius**2).clamp(min=0)
    return torch.stack([0.07 * d["relief"] / n * dome, 0 * dome], 1)


def squares(d: Draws) -> Tensor:
    """Flat squares, as on a keypad or a mat."""
    u, v, n = _places(d)
    return _raised((torch.maximum(u.abs(), v.abs()) - 0.27 - 0.12 * d["shape"]) / n, n, d)


def pyramids(d: Draws) -> Tensor:
    """Pyramids side by side."""
    u, v, n = _places(d)
    up = 1 - 2 * torch.maximum(u.abs(), v.abs())
    return torch.stack([0.14 * d["relief"] / n * up, smooth(1 - 4 * up)], 1)


def weave(d: Draws) -> Tensor:
    """Bands over and under each other."""
    u, v, n = _places(d)
    x, y = texels(d.size)
    over = ((x * n).floor() + (y * n).floor()).remainder(2) < 0.5
    along, across = torch.where(over, u, v), torch.where(over, v, u)
    band = torch.cos(math.pi * along) * (1 - (2 * across.abs()) ** 4)
    return torch.stack([0.065 * d["relief"] / n * band, smooth(1 - 2.5 * band)], 1)


def rings(d: Draws) -> Tensor:
    """Circles around the middle of each field, as a logo or a grip has them."""
    x, y = texels(d.size)
    n = (1 + 2 * d["count"]).floor()
    r = torch.hypot(wrapped(x * n + 0.5), wrapped(y * n + 0.5)).clamp(max=0.5)
    turns = 4 + (3 * d["shape"]).floor()
    return _raised((wrapped(r * turns).abs() - 0.25) / (turns * n), n * turns, d)


def _places(d: Draws, staggered: bool = False) -> tuple[Tensor, Tensor, Tensor]:
    """Places in n × n cells, from their middles: u, v (B, S, S) in widths of a cell, and n, even."""
    x, y = texels(d.size)
    n = 2 * (2 + 5 * d["count"]).floor()
    row = (y * n).floor()
    shift = 0.5 * row.remainder(2) if staggered else 0 * row
    u, v = (x * n + shift).remainder(1.0) - 0.5, (y * n - row - 0.5) + 0 * x
    return u, v, n


def _raised(distance: Tensor, n: Tensor, d: Draws) -> Tensor:
    """Height and creases of parts that stand out where the distance to their edge is negative."""
    inside = smooth(0.5 - distance * (n * 5).clamp(max=d.size / 2)).expand(-1, d.size, d.size)
    return torch.stack([0.05 * d["relief"] / n * inside, 0.6 * (1 - inside)], 1)


MOULDS = (plain, plain, plain, eroded, eroded, leather, ribs, dots, squares, pyramids, weave, rings)
