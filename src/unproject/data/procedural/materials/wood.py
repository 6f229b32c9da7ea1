"""Woods: boards with rings, fibres, pores and knots. The grain runs up the picture, along y.

Rings are where a board cuts the shells of a tree whose axis, the pith, lies d below the board and p beside its middle,

    r = √((x - p)² + d² (1 + a cos 2π(y - y₀))²) + knots + warp,     phase = rings · r

near the pith the arches of a flat-sawn board, beside it the stripes of a quarter-sawn one. Within a ring, pale
earlywood turns to dark latewood and breaks off. Pores are short dark dashes along the fibres, in some woods in the
earlywood alone.

A picture shows one board, or 2 to 5 beside each other with gaps, some of them cut across; gaps, pores, rings and knots
make the height. Along the grain it repeats itself; across it too, where there are gaps: a single board's rings end at
the edge of the tile.

Specular and roughness are functions of the diffuse map, `wood_gloss`, as an artist's transfer function would be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ....ops.maps import luminance, pack_maps
from ..span import Span
from .noise import Chances, Draws
from .patterns import colours, covered, normals, smooth, texels, wrapped


class Species(NamedTuple):
    """Colours of early- and latewood in sRGB, and what else tells a wood by."""

    early: tuple[float, float, float]
    late: tuple[float, float, float]
    rings: float  # contrast of the rings
    pores: float  # how many pores
    porous: float  # 1 if they keep to the earlywood
    knots: float  # how many of the pictures have knots


SPECIES = {
    "pine": Species((0.87, 0.71, 0.49), (0.70, 0.44, 0.22), 1.0, 0.0, 0.0, 0.6),
    "spruce": Species((0.89, 0.79, 0.62), (0.74, 0.55, 0.35), 0.9, 0.0, 0.0, 0.5),
    "oak": Species((0.75, 0.59, 0.40), (0.58, 0.41, 0.25), 0.8, 1.0, 0.8, 0.1),
    "ash": Species((0.82, 0.72, 0.57), (0.62, 0.49, 0.34), 0.9, 0.8, 1.0, 0.1),
    "maple": Species((0.87, 0.74, 0.57), (0.77, 0.61, 0.43), 0.6, 0.1, 0.0, 0.1),
    "birch": Species((0.88, 0.77, 0.61), (0.80, 0.65, 0.47), 0.6, 0.15, 0.0, 0.2),
    "beech": Species((0.79, 0.61, 0.46), (0.68, 0.48, 0.34), 0.5, 0.5, 0.0, 0.0),
    "cherry": Species((0.69, 0.42, 0.26), (0.53, 0.28, 0.16), 0.7, 0.2, 0.0, 0.1),
    "walnut": Species((0.48, 0.34, 0.24), (0.27, 0.17, 0.11), 0.8, 0.5, 0.3, 0.15),
    "mahogany": Species((0.55, 0.28, 0.17), (0.39, 0.17, 0.10), 0.5, 0.7, 0.0, 0.0),
    "teak": Species((0.66, 0.46, 0.27), (0.45, 0.28, 0.15), 0.8, 0.5, 0.6, 0.0),
    "wenge": Species((0.33, 0.25, 0.19), (0.14, 0.09, 0.07), 0.8, 0.6, 0.0, 0.0),
    "weathered": Species((0.64, 0.62, 0.58), (0.43, 0.41, 0.38), 1.0, 0.6, 0.0, 0.4),
}

BOARDS, KNOTS = 12, 3
CHANCES = Chances(
    "wood",
    {
        "species": Span(0, len(SPECIES) - 1e-4, "index into `SPECIES`"),
        "lightness": Span(-0.25, 0.25, "log of what the colour is scaled by: finish and age"),
        "warmth": Span(-0.04, 0.04, "log of what red is scaled by, and blue divided by"),
        "boards": Span(-2.5, 5.99, "beside each other, rounded down; one, without gaps, below 2"),
        "cut": Span(-1.0, 1.0, "boards are cut across if above 0.4"),
        "shift": Span(0, 1, "where the first gap lies, in widths of a board"),
        "gap": Span(0.006, 0.018, "width of a gap"),
        "depth": Span(0.002, 0.009, "depth of a gap"),
        "rings": Span(8, 20, "rings a width of the tile"),
        "arch": Span(0.03, 0.28, "a: how far the pith comes and goes"),
        "warp": Span(0.004, 0.022, "how far the rings wander"),
        "sharpness": Span(1.2, 3.5, "exponent of the way from early- to latewood"),
        "contrast": Span(0.55, 1.0, "of the rings"),
        "fibres": Span(0.03, 0.10, "standard deviation of the log colour from fibre to fibre"),
        "tones": Span(0.02, 0.10, "the same, of broad streaks"),
        "relief": Span(0.0, 0.0012, "height of latewood above earlywood"),
        "coarse": Span(0.0004, 0.0016, "depth of a pore"),
        "dark": Span(0.2, 0.5, "how much darker a pore is"),
        "dash": Span(4, 9, "cycles a tile along y that pores have: few are long pores"),
        "knotty": Span(0, 1, "knots if below the species' share"),
    },
    {"board": 6 * BOARDS, "knot": 4 * KNOTS},
    ("warp", "fibres", "tones", "pores"),
)


@dataclass(frozen=True)
class Boards:
    """Where each texel lies: x from the middle of its board, distance to the nearest gap, and its board's numbers."""

    x: Tensor
    width: Tensor
    to_gap: Tensor  # beyond the tile where there is no gap
    number: tuple[Tensor, ...]  # six (B, S, S), uniform over the boards


def build_wood(d: Draws) -> Tensor:
    """Maps (B, 8, S, S) of drawn woods."""
    boards = lay_boards(d)
    knot, heart = knots(d, boards)
    phase = rings(d, boards, knot)
    late = latewood(d, phase)
    pores = pore_dashes(d, late)
    gap = covered(boards.to_gap - d["gap"] / 2, d.size)
    diffuse = stain(d, boards, late, heart) * (1 - d["dark"] * pores)[:, None] * (1 - 0.85 * gap)[:, None]
    bevel = (1 - smooth(boards.to_gap / (d["gap"] + 0.02))) * 0.25
    height = d["relief"] * late - d["coarse"] * pores - d["depth"] * (gap + bevel) + 0.002 * heart
    diffuse = diffuse.clamp(0.003, 0.95)
    specular, roughness = wood_gloss(diffuse)
    return pack_maps({"diffuse": diffuse, "specular": specular, "roughness": roughness, "normal": normals(height)})


def wood_gloss(diffuse: Tensor) -> tuple[Tensor, Tensor]:
    """The transfer function: specular and roughness (B, 1, H, W) of a diffuse map (B, 3, H, W) alone.

    With Y the luminance, Ȳ its mean over the map and c = 1 - min/max of the mean colour's channels,

        k_s = 0.042 (Y/Ȳ)^0.7     within [0.004, 0.09]
        m = (0.14 + 0.34 √Ȳ + 0.25 max(0, 1 - c/0.3)) (Y/Ȳ)^-0.5     within [0.05, 0.9]

    pores, gaps and latewood reflect less, and are duller; dark woods are polished, pale ones raw, grey ones weathered.
    """
    light = luminance(diffuse)
    mean, colour = light.mean((2, 3), keepdim=True), diffuse.mean((2, 3), keepdim=True)
    chroma = 1 - colour.amin(1, keepdim=True) / colour.amax(1, keepdim=True).clamp(min=1e-6)
    share = (light / mean.clamp(min=1e-6)).clamp(min=1e-6)
    base = 0.14 + 0.34 * mean.clamp(min=0).sqrt() + 0.25 * (1 - chroma / 0.3).clamp(min=0)
    return (0.042 * share**0.7).clamp(0.004, 0.09), (base * share**-0.5).clamp(0.05, 0.9)


def species_of(d: Draws, field: str) -> Tensor:
    """A number (B, 1, 1) of each item's species."""
    return torch.tensor([getattr(s, field) for s in SPECIES.values()])[d["species"].flatten().long()][:, None, None]


def lay_boards(d: Draws) -> Boards:
    """Boards beside each other, each cut across at two places or none."""
    x, y = texels(d.size)
    count = d["boards"].floor().clamp(min=1)
    several = count > 1
    place = x * count + d["shift"] * several
    column = place.floor().remainder(count)
    across = place - place.floor()
    joint = _of_board(d, 5, 2 * column).expand(-1, d.size, -1)
    y_cut = (y - joint).remainder(1.0)
    cut = (count > 2) & (d["cut"] > 0.4)
    second = (y_cut > 0.55) & cut
    board = 2 * column + second
    to_side = torch.minimum(across, 1 - across) / count
    to_end = torch.minimum(wrapped(y_cut).abs(), (y_cut - 0.55).abs())
    far = torch.full_like(y_cut, 9.0)
    to_gap = torch.where(several, torch.minimum(to_side, torch.where(cut, to_end, far)), far)
    return Boards(
        ((across - 0.5) / count).expand(-1, d.size, -1),
        1 / count,
        to_gap,
        tuple(_of_board(d, k, board) for k in range(6)),
    )


def _of_board(d: Draws, k: int, board: Tensor) -> Tensor:
    """The k-th number of each texel's board."""
    table = d.table("board").view(-1, BOARDS, 6)[:, :, k]
    return table.gather(1, board.long().flatten(1)).view_as(board)


def knots(d: Draws, boards: Boards) -> tuple[Tensor, Tensor]:
    """How far knots push the rings aside, and the knots themselves (1 inside)."""
    x, y = texels(d.size)
    push, inside = torch.zeros_like(boards.x), torch.zeros_like(boards.x)
    some = (d["knotty"] < species_of(d, "knots")).float()
    for k, one in enumerate(d.table("knot").view(-1, KNOTS, 4).unbind(1)):
        px, py, radius, there = one[:, :, None, None].unbind(1)
        present = some * (there > 0.4 * k)
        radius = 0.018 + 0.035 * radius
        distance = torch.hypot(wrapped(x - px), 0.7 * wrapped(y - py)) / radius
        push = push + present * radius * 2.2 * torch.exp(-0.5 * (distance / 1.7) ** 2)
        inside = torch.maximum(inside, present * covered((distance - 1) * radius, d.size, 2))
    return push, inside


def rings(d: Draws, boards: Boards, knot: Tensor) -> Tensor:
    """How many rings lie between the pith and each texel; neighbours differ in width."""
    _, y = texels(d.size)
    pith, deep, start, *_ = boards.number
    below = boards.width * (0.05 + 0.45 * deep) * (1 + d["arch"] * torch.cos(2 * math.pi * (y - start)))
    aside = boards.x - 2.2 * (pith - 0.5) * boards.width
    r = torch.hypot(aside, below) + knot + d["warp"] * d.streaks("warp", 4.0, 1.8)
    phase = d["rings"] * r + 7 * start
    return phase + 0.25 * torch.sin(1.7 * phase) + 0.6 * torch.sin(0.61 * phase + 1)


def latewood(d: Draws, phase: Tensor) -> Tensor:
    """0 in earlywood to 1 in latewood, which ends within a seventh of a ring; rings differ in strength."""
    t = phase - phase.floor()
    strength = 0.75 + 0.25 * torch.sin(2.4 * phase.floor())
    return strength * (t / 0.86).clamp(max=1) ** d["sharpness"] * (1 - smooth((t - 0.86) / 0.14))


def pore_dashes(d: Draws, late: Tensor) -> Tensor:
    many = species_of(d, "pores")
    keep = 1 - species_of(d, "porous") * smooth(1.6 * late)
    return smooth(d.streaks("pores", 40.0, d["dash"]) - 1.9 + 1.2 * many) * keep * (many > 0)


def stain(d: Draws, boards: Boards, late: Tensor, heart: Tensor) -> Tensor:
    """The colour (B, 3, S, S) before pores and gaps."""
    which, tint, side = d["species"], boards.number[3], boards.number[4]
    early, dark = (colours(table, which) for table in zip(*((s.early, s.late) for s in SPECIES.values())))
    share = late * d["contrast"] * species_of(d, "rings")
    flip = torch.where(side > 0.5, 1.0, -1.0)
    fibre = d["fibres"] * d.streaks("fibres", 40.0, 2.0) + d["tones"] * d.streaks("tones", 9.0, 1.5)
    tone = d["lightness"] + 0.3 * (tint - 0.5) + flip * fibre
    warm = d["warmth"] + 0.04 * (side - 0.5)
    colour = early * (dark / early) ** share[:, None]
    colour = colour * torch.exp(torch.stack([tone + warm, tone, tone - warm], 1))
    return torch.lerp(colour, 0.45 * dark * (1 - 0.4 * late)[:, None], 0.85 * heart[:, None])
