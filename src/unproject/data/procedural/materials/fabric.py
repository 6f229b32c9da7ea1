"""Fabrics: woven of two sets of threads, knitted, ribbed or felted; of one colour, striped, checked or printed.

A weave is a rule that says at each crossing whether the warp, which runs along y, or the weft lies on top. A thread is
a band that is round across and dives where it goes under another one,

    height = thickness · top,   top = cos(π along) · (1 - (2 across / width)⁴)

of along and across in widths of a crossing, from its middle; a float, which passes over several, dives at its ends
only. Threads that stand out are polished, what lies between them is dark, dull and reflects less:

    k_d = colour · (1 - dirt · (1 - top)),   k_s = k · (1 - ½ (1 - top)),   m = m₀ · exp(-wear · top + fibres)

of a fibre's k and m₀: wool and cotton are matt, silk and polyester glossy. A thread has one colour. A print lies on
the threads: it has a colour and a gloss of its own and no relief. All tile; warp and wales run along y.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ....ops.maps import pack_maps
from ..span import Span
from .noise import Chances, Draws, by_kind
from .patterns import colours, normals, smooth, texels, wrapped

DYES = (
    (0.93, 0.91, 0.86),
    (0.78, 0.70, 0.57),
    (0.13, 0.13, 0.14),
    (0.45, 0.45, 0.46),
    (0.14, 0.20, 0.40),
    (0.33, 0.46, 0.62),
    (0.55, 0.10, 0.13),
    (0.80, 0.42, 0.30),
    (0.22, 0.34, 0.22),
    (0.52, 0.52, 0.27),
    (0.82, 0.64, 0.20),
    (0.38, 0.22, 0.34),
)
"""Colours of threads in sRGB, from white and flax to plum."""
BANDS = 8
"""Places in a tile where colours are drawn, as many as coarse weaves have threads; a thread has that of its middle."""
MAX_PER_TILE = 16
"""Threads a tile at most."""

CHANCES = Chances(
    "fabric",
    {
        "weave": Span(0, 10 - 1e-4, "index into `WEAVES`, plain twice"),
        "design": Span(0, 1, "one colour below 0.4, then two sets of threads to 0.55, stripes to 0.75, checks"),
        "first": Span(0, len(DYES) - 1e-4, "index into `DYES`, of the warp"),
        "second": Span(0, len(DYES) - 1e-4, "the same, of the weft or of the other bands"),
        "third": Span(0, len(DYES) - 1e-4, "the same, of the print"),
        "print": Span(0, 1, "none below 0.65, dots to 0.8, blots to 0.9, a trellis"),
        "repeats": Span(2, 5 - 1e-4, "how often dots and lines of a print are repeated"),
        "ink": Span(0.5, 1.4, "roughness of the print, of that of the threads"),
        "fibre": Span(0, 1, "wool and cotton below 0.6, above it silk and polyester"),
        "gloss": Span(0, 1, "of the fibre, within its kind"),
        "light": Span(-0.25, 0.25, "log of how much lighter the dyes are"),
        "count": Span(0, 1, "how many threads there are"),
        "thick": Span(0.3, 1.0, "thickness of threads, of the thickest"),
        "width": Span(0.80, 1.0, "of a thread, of the room that it has"),
        "dirt": Span(0.25, 0.75, "how much darker it is between threads"),
        "wear": Span(0.10, 0.50, "how much of log m the tops lose"),
        "fuzz": Span(0.1, 1.0, "how much single fibres show"),
        "melange": Span(-0.5, 0.35, "standard deviation of log k_d from fibre to fibre; none below 0"),
        "creases": Span(-1.0, 1.0, "how deep the cloth is creased; it lies flat below 0"),
    },
    {"bands": 2 * BANDS},
    ("fibres", "creases", "melange", "print", "tufts"),
)

Over = Callable[[Tensor, Tensor], Tensor]
"""Whether the warp lies on top where thread i of the warp crosses thread j of the weft; whole numbers as floats."""


def build_fabric(d: Draws) -> Tensor:
    """Maps (B, 8, S, S) of drawn fabrics."""
    height, top, warp, *middles = by_kind(d["weave"], WEAVES, d).unbind(1)
    fibres = d.grain("fibres", 24.0, 10.0)
    hollow = 1 - top
    inked = printed(d)
    melange = d["melange"].clamp(min=0) * d.grain("melange", 18.0, 12.0).clamp(-2, 2)
    dyed = torch.lerp(threads(d, warp, middles), dye(d, "third"), inked[:, None])
    shade = torch.exp(melange + 0.05 * d["fuzz"] * fibres) * (1 - d["dirt"] * hollow)
    k, m = fibre(d)
    worn = -d["wear"] * top + 0.08 * d["fuzz"] * fibres.clamp(-3, 3)
    creased = 0.006 * d["creases"].clamp(min=0) * d.clouds("creases", 2.2)
    maps = {
        "diffuse": (dyed * shade[:, None]).clamp(max=0.9),
        "specular": (k * (1 - 0.5 * hollow))[:, None],
        "roughness": (m * torch.exp(worn) * torch.lerp(torch.ones_like(m), d["ink"], inked)).clamp(0.05, 0.9)[:, None],
        "normal": normals(height + creased + 0.0005 * d["fuzz"] * fibres),
    }
    return pack_maps(maps)


def fibre(d: Draws) -> tuple[Tensor, Tensor]:
    """k_s and m of the fibre, each (B, 1, 1)."""
    silk = d["fibre"] >= 0.6
    k = torch.where(silk, 0.045 + 0.030 * d["gloss"], 0.030 + 0.015 * d["gloss"])
    return k, torch.where(silk, 0.40 - 0.20 * d["gloss"], 0.80 - 0.25 * d["gloss"])


def dye(d: Draws, name: str) -> Tensor:
    """Linear colour (B, 3, 1, 1)."""
    return colours(DYES, d[name]) * torch.exp(d["light"])[..., None]


def threads(d: Draws, warp: Tensor, middles: Sequence[Tensor]) -> Tensor:
    """Colours (B, 3, S, S) of the threads on top.

    Args:
        warp: 1 where the warp is, 0 where the weft is.
        middles: x of the middle of the warp's thread, y of the weft's, in [0, 1).
    """
    design, (along_x, along_y) = d["design"], (other_bands(d, axis, middle) for axis, middle in enumerate(middles))
    # Stripes are in warp and weft alike: in half of the weaves a weft of one colour would hide them.
    bands = torch.where(design < 0.75, along_x, along_y)
    second_weft = torch.where(design < 0.55, (design >= 0.4).float(), bands)
    second_warp = torch.where(design < 0.55, 0.0, along_x)
    return torch.lerp(dye(d, "first"), dye(d, "second"), torch.where(warp > 0.5, second_warp, second_weft)[:, None])


def other_bands(d: Draws, axis: int, middle: Tensor) -> Tensor:
    """1 where threads of this axis have the second colour, (B, S, S)."""
    drawn = d.table("bands")[:, axis * BANDS : (axis + 1) * BANDS] < 0.4
    return drawn.gather(1, (middle * BANDS).long().flatten(1)).view_as(middle).float()


def printed(d: Draws) -> Tensor:
    """Share (B, S, S) of ink: dots, blots, or a trellis of lines."""
    x, y = texels(d.size)
    n = d["repeats"].floor()
    row = (y * n * 2).floor()
    u, v = wrapped(x * n + 0.5 * row.remainder(2) + 0.5), (y * n * 2 - row - 0.5) / 2
    dots = smooth(0.5 + (0.17 - torch.hypot(u, v)) * d.size / n)
    blots = smooth(0.5 + 2.5 * (d.grain("print", 3.5, 1.5) - 0.7))
    lines = torch.minimum(wrapped((x + y) * n).abs(), wrapped((x - y) * n).abs())
    trellis = smooth(0.5 + (0.09 - lines) * d.size / n)
    chosen = torch.where(d["print"] < 0.8, dots, torch.where(d["print"] < 0.9, blots, trellis))
    return chosen * (d["print"] >= 0.65)


def woven(over: Over, repeat: int) -> Callable[[Draws], Tensor]:
    """Return what makes height, top, warp or weft, and the middles of both threads, (B, 5, S, S)."""

    def made(d: Draws) -> Tensor:
        x, y = texels(d.size)
        wanted = BANDS + (MAX_PER_TILE - BANDS) * d["count"]
        n = repeat * torch.ceil(wanted / repeat - 0.5).clamp(1, MAX_PER_TILE // repeat)
        i, j = ((z * n).floor() for z in (x, y))
        u, v = x * n - i - 0.5 + 0 * j, y * n - j - 0.5 + 0 * i
        above = over(i, j)
        along, across = torch.where(above, v, u), torch.where(above, u, v) / d["width"]
        before = torch.where(above, over(i, j - 1), ~over(i - 1, j))
        after = torch.where(above, over(i, j + 1), ~over(i + 1, j))
        passes = torch.where(along > 0, after, before)
        dive = torch.where(passes, torch.ones_like(along), torch.cos(math.pi * along))
        top = (dive * (1 - (2 * across) ** 4)).clamp(min=0)
        return _made(0.10 * d["thick"] / n * top, top, above.float(), (i + 0.5) / n, (j + 0.5) / n)

    return made


def plain(i: Tensor, j: Tensor) -> Tensor:
    return (i + j).remainder(2) < 0.5


def twill(i: Tensor, j: Tensor) -> Tensor:
    return (i + j).remainder(4) < 1.5


def denim(i: Tensor, j: Tensor) -> Tensor:
    return (i + j).remainder(4) < 2.5


def satin(i: Tensor, j: Tensor) -> Tensor:
    return (i + 2 * j).remainder(5) > 0.5


def basket(i: Tensor, j: Tensor) -> Tensor:
    return ((i / 2).floor() + (j / 2).floor()).remainder(2) < 0.5


def herringbone(i: Tensor, j: Tensor) -> Tensor:
    at = i.remainder(8)
    return (torch.where(at < 3.5, at, 7 - at) + j).remainder(4) < 1.5


def knitted(d: Draws) -> Tensor:
    """Rows of stitches, each of two legs that lean towards each other. Its threads run along x."""
    x, y = texels(d.size)
    wales = (4 + 4.99 * d["count"]).floor()
    u = (x * wales).remainder(1.0) - 0.5
    rows = (1.4 * wales).round()
    row = y * rows + 0.8 * u.abs()
    leg = (1 - (4 * (u.abs() - 0.25)) ** 2).clamp(min=0)
    top = leg * torch.sin(math.pi * row.remainder(1.0)).clamp(min=0) ** 0.6
    middles = ((x * wales).floor() + 0.5) / wales, ((row.floor() + 0.5) / rows).remainder(1.0)
    return _made(0.12 * d["thick"] / wales * top, top, torch.zeros_like(top), *middles)


def corduroy(d: Draws) -> Tensor:
    """Round wales of pile."""
    x, y = texels(d.size)
    wales = (4 + 8.99 * d["count"]).floor()
    top = torch.cos(math.pi * wrapped(x * wales)).clamp(min=0).expand(-1, d.size, -1) ** 0.7
    return _made(0.14 * d["thick"] / wales * top, top, torch.ones_like(top), ((x * wales).round() / wales) % 1, y)


def felt(d: Draws) -> Tensor:
    """Fibres that lie anyhow, pressed."""
    x, y = texels(d.size)
    tufts = d.grain("tufts", 9.0, 5.0)
    top = smooth(0.7 + 0.25 * tufts)
    return _made(0.004 * d["thick"] * tufts, top, torch.ones_like(top), x, y)


def _made(height: Tensor, top: Tensor, *rest: Tensor) -> Tensor:
    return torch.stack([height, *(part.expand_as(height) for part in (top, *rest))], 1)


WEAVES = (
    woven(plain, 2),
    woven(plain, 2),
    woven(twill, 4),
    woven(denim, 4),
    woven(satin, 5),
    woven(basket, 4),
    woven(herringbone, 8),
    knitted,
    corduroy,
    felt,
)
