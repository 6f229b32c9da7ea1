"""Metals: brushed, scratched, worn, hammered, ribbed, embossed, perforated and riveted; bare, corroded or painted.

A bare metal has next to no diffuse albedo. Its k_s is its reflectance at normal incidence, a colour; or, as a map of
one channel cannot hold the tint of copper or gold, the luminance of it, with a trace of the tint in k_d. Corrosion and
paint are dielectrics that cover the metal where their mask is 1,

    k = bare + mask · (cover - bare)   for k_d, k_s and m,   height + mask · thickness

corrosion (rust on iron, verdigris on copper) where noise says so and first of all in hollows; paint everywhere but
where it has chipped, first of all where the metal stands out. Scratches, dents and the structure itself make the height
and, with it, the roughness: what stands out is polished, what lies deep is dull. Brushed and ribbed metals run along x;
nothing else has a direction. All tile.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ....ops.maps import luminance, pack_maps
from ..span import Span
from .noise import Chances, Draws, by_kind, standardised
from .patterns import cells, colours, covered, normals, scratches, smooth, texels, wrapped


class Metal(NamedTuple):
    """Reflectance at normal incidence, linear, and what grows on it."""

    reflectance: tuple[float, float, float]
    corrosion: str


METALS = {
    "steel": Metal((0.56, 0.57, 0.58), "rust"),
    "stainless": Metal((0.66, 0.65, 0.63), "rust"),
    "iron": Metal((0.53, 0.51, 0.49), "rust"),
    "chrome": Metal((0.55, 0.56, 0.55), "rust"),
    "nickel": Metal((0.66, 0.61, 0.53), "rust"),
    "aluminium": Metal((0.91, 0.92, 0.92), "oxide"),
    "zinc": Metal((0.66, 0.69, 0.72), "oxide"),
    "titanium": Metal((0.54, 0.50, 0.45), "dirt"),
    "gold": Metal((1.00, 0.77, 0.34), "dirt"),
    "copper": Metal((0.95, 0.64, 0.54), "verdigris"),
    "brass": Metal((0.89, 0.75, 0.42), "verdigris"),
    "bronze": Metal((0.72, 0.51, 0.30), "verdigris"),
}
CORROSION = {
    "rust": ((0.52, 0.28, 0.13), (0.33, 0.16, 0.09)),
    "oxide": ((0.62, 0.62, 0.60), (0.45, 0.45, 0.44)),
    "dirt": ((0.22, 0.18, 0.13), (0.12, 0.10, 0.08)),
    "verdigris": ((0.36, 0.60, 0.52), (0.20, 0.38, 0.32)),
}
"""Two colours each, in sRGB, mixed by noise."""

PAINT = (
    (0.62, 0.10, 0.09),
    (0.83, 0.62, 0.08),
    (0.11, 0.26, 0.52),
    (0.12, 0.40, 0.22),
    (0.85, 0.85, 0.82),
    (0.83, 0.36, 0.07),
    (0.30, 0.32, 0.33),
    (0.42, 0.60, 0.60),
)
DIELECTRIC = 0.04
SCRATCHES, SIDE = 24, 16

CHANCES = Chances(
    "metal",
    {
        "metal": Span(0, len(METALS) - 1e-4, "index into `METALS`"),
        "structure": Span(0, 10 - 1e-4, "index into `STRUCTURES`, brushed and scratched twice"),
        "finish": Span(0, 1, "bare below 0.5, then corroded to 0.75, painted"),
        "roughness": Span(0.08, 0.40, "m of the bare metal"),
        "clouds": Span(0.05, 0.30, "standard deviation of log m from place to place"),
        "relief": Span(0.3, 1.0, "how strong the structure is, of the strongest it can be"),
        "count": Span(0, 1, "how many periods a pattern has"),
        "hits": Span(-0.5, 1.0, "how deep scratches are; none below 0"),
        "amount": Span(-1.0, 1.2, "how much corrosion, in standard deviations of its noise"),
        "chips": Span(-2.2, 0.2, "how much paint has gone, the same way"),
        "colour": Span(0, 1, "of the paint, as a share of its table; the lightness of corrosion"),
        "gloss": Span(0.08, 0.35, "m of the paint"),
        "patina": Span(-0.6, 1.0, "how much tarnish; none below 0"),
    },
    {"place": 2, "scratch": 5 * SCRATCHES, "jitter": 2 * SIDE * SIDE},
    ("brush", "clouds", "dents", "cover", "rust"),
)


class Surface(NamedTuple):
    """k_d, k_s and m of one layer."""

    diffuse: Tensor
    specular: Tensor
    roughness: Tensor

    def under(self, cover: Surface, mask: Tensor) -> Surface:
        return Surface(*(torch.lerp(a, b.expand_as(a), mask.expand_as(a)) for a, b in zip(self, cover)))


def build_metal(d: Draws, coloured: bool = False) -> Tensor:
    """Maps (B, 8, S, S) of drawn metals; (B, 10, S, S) with `coloured` reflectances and no tint in k_d."""
    height, dull, hole = by_kind(d["structure"], STRUCTURES, d).unbind(1)
    scratch = d["hits"].clamp(min=0) * scratches(d.table("scratch"), d.size)
    surface = bare(d, dull + 0.8 * scratch, coloured)
    hollow = standardised(-height)
    rust, paint = rust_mask(d, hollow), paint_mask(d, hollow)
    surface = surface.under(corroded(d), rust[:, None]).under(painted(d), paint[:, None])
    surface = surface.under(dark(surface), (0.97 * hole)[:, None])
    height = height - 0.0025 * scratch * (1 - rust) + rust * 0.0012 * d.clouds("rust", 0.6) + 0.003 * paint
    diffuse, specular, roughness = surface
    roughness = roughness.clamp(0.03, 0.9)
    return pack_maps({"diffuse": diffuse, "specular": specular, "roughness": roughness, "normal": normals(height)})


def bare(d: Draws, dull: Tensor, coloured: bool) -> Surface:
    """The metal itself, tarnished here and there."""
    tint = torch.tensor([metal.reflectance for metal in METALS.values()])[d["metal"].flatten().long()][:, :, None, None]
    clouds = d.clouds("clouds", 1.4)
    tarnish = d["patina"].clamp(min=0) * smooth(0.3 + 0.4 * clouds)
    grey = luminance(tint)
    diffuse = 0.03 * (grey.expand_as(tint) if coloured else tint) ** 2 * (0.3 + tarnish)[:, None]
    specular = (tint if coloured else grey) * (1 - 0.35 * tarnish)[:, None]
    roughness = d["roughness"] * torch.exp(d["clouds"] * clouds + dull + 0.5 * tarnish)
    return Surface(diffuse, specular, roughness[:, None])


def rust_mask(d: Draws, hollow: Tensor) -> Tensor:
    noise = standardised(d.clouds("cover", 1.2) + 0.5 * hollow)
    rusty = (d["finish"] >= 0.5) & (d["finish"] < 0.75)
    return smooth(1.6 * (noise - 0.6 + d["amount"])) * rusty


def corroded(d: Draws) -> Surface:
    """What corrosion leaves: two colours mixed by noise, matt."""
    pairs = [CORROSION[metal.corrosion] for metal in METALS.values()]
    first, second = (colours([pair[k] for pair in pairs], d["metal"]) for k in (0, 1))
    noise = d.clouds("rust", 0.8)
    light = torch.exp(0.15 * noise + 0.5 * (d["colour"] - 0.5))[:, None]
    diffuse = torch.lerp(first, second, smooth(0.5 + 0.4 * noise)[:, None]) * light
    flat = torch.zeros_like(noise)[:, None]
    return Surface(diffuse, flat + 0.03, flat + 0.55 + 0.05 * noise[:, None].clamp(-2, 2))


def paint_mask(d: Draws, hollow: Tensor) -> Tensor:
    noise = standardised(d.clouds("cover", 1.0) - 0.4 * hollow)
    return (1 - smooth(3 * (noise - 0.6 + d["chips"]))) * (d["finish"] >= 0.75)


def painted(d: Draws) -> Surface:
    """Paint of one colour, a little dirty."""
    dirt = d.clouds("clouds", 1.4).clamp(min=0)[:, None]
    diffuse = colours(PAINT, d["colour"] * (len(PAINT) - 1e-3)) * torch.exp(-0.12 * dirt)
    return Surface(diffuse, torch.full_like(dirt, DIELECTRIC), d["gloss"][:, None] * torch.exp(0.25 * dirt))


def dark(like: Surface) -> Surface:
    """What is seen through a hole."""
    diffuse, specular, roughness = (torch.zeros_like(x) for x in like)
    return Surface(diffuse + 0.01, specular + 0.02, roughness + 0.6)


def brushed(d: Draws) -> Tensor:
    """Fine lines along x."""
    lines = d.streaks("brush", 2.5, 60.0)
    return _structure(0.0003 * d["relief"] * lines, 0.4 + 0.1 * lines)


def scratched(d: Draws) -> Tensor:
    """Long scratches in all directions over a polished sheet."""
    lines = scratches(d.table("scratch").flip(1), d.size, longest=0.45)
    return _structure(-0.004 * d["relief"] * lines, 1.2 * lines - 0.4)


def worn(d: Draws) -> Tensor:
    """Dents and stains."""
    dents = d.grain("dents", 2 + 8 * d["count"], 2.0)
    return _structure(0.006 * d["relief"] / (1 + 4 * d["count"]) * dents, 0.25 * d.clouds("brush", 1.0))


def hammered(d: Draws) -> Tensor:
    """Round facets side by side."""
    n = (4 + 7 * d["count"]).floor()
    nearest, _ = cells(n, d.table("jitter"), d.size)
    return _structure(0.2 * d["relief"] / n * nearest.clamp(max=0.9) ** 2, 0 * nearest)


def ribbed(d: Draws) -> Tensor:
    """Corrugated: waves along x, n of them up the tile."""
    _, y = texels(d.size)
    n = (3 + 8 * d["count"]).floor()
    wave = torch.cos(2 * math.pi * n * y).expand(-1, -1, d.size)
    return _structure(0.045 * d["relief"] / n * wave, -0.15 * wave)


def plate(d: Draws) -> Tensor:
    """Diamond plate: lozenges that lean to the left and to the right by turns."""
    x, y = texels(d.size)
    n = 2 * (2 + 2 * d["count"]).floor()
    i, j = (x * n).floor(), (y * n).floor()
    u, v = x * n - i - 0.5, y * n - j - 0.5
    lean = torch.where((i + j).remainder(2) < 0.5, 1.0, -1.0)
    along, across = (u + lean * v) * math.sqrt(0.5), (v - lean * u) * math.sqrt(0.5)
    bump = smooth(1.6 * (1 - torch.hypot(along / 0.52, across / 0.2)))
    return _structure(0.04 * d["relief"] / n * bump, -0.35 * bump)


def perforated(d: Draws) -> Tensor:
    """Round holes, in rows or staggered."""
    x, y = texels(d.size)
    n = 2 * (2 + 3 * d["count"]).floor()
    row = (y * n).floor()
    staggered = (d["relief"] > 0.65) * 0.5 * row.remainder(2)
    u, v = (x * n + staggered).remainder(1.0) - 0.5, y * n - row - 0.5
    radius = 0.22 + 0.14 * d["gloss"] / 0.35
    edge = (torch.hypot(u, v) - radius) / n
    return _structure(-0.008 * covered(edge, d.size, 2), 0 * edge, covered(edge, d.size))


def riveted(d: Draws) -> Tensor:
    """Sheets with a seam around each and rivets along the seams."""
    x, y = (z + d.table("place")[:, k, None, None] for k, z in enumerate(texels(d.size)))
    n = (1 + 1.99 * d["count"]).floor()
    m = torch.where(n > 1, 4, 3 + (6 * d["relief"]).floor())
    seam = covered(torch.minimum(wrapped(x * n).abs(), wrapped(y * n).abs()) / n - 0.008, d.size, 2)
    i, j = (x * n * m).floor(), (y * n * m).floor()
    edge = (i.remainder(m) % (m - 1) == 0) | (j.remainder(m) % (m - 1) == 0)
    r = torch.hypot(x * n * m - i - 0.5, y * n * m - j - 0.5)
    dome = edge * (1 - (r / 0.27) ** 2).clamp(min=0)
    return _structure(0.05 / (n * m) * dome - 0.006 * seam, 0.4 * seam - 0.2 * dome)


def _structure(height: Tensor, dull: Tensor, hole: Tensor | None = None) -> Tensor:
    """(B, 3, S, S): height, what log m is raised by, and holes."""
    return torch.stack([height, dull, torch.zeros_like(height) if hole is None else hole], 1)


STRUCTURES = (brushed, brushed, scratched, scratched, worn, hammered, ribbed, plate, perforated, riveted)
