"""A procedural data set of birds that stand: body, neck, head, beak, wings at the sides or half open, tail, legs.

They are upright (y up), face +z, are mirror images of themselves in x = 0, and lie inside |x|, |y| < 0.95; of
few, with a long body, neck and beak, the tip reaches z = 1.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..span import Span
from .solids import Grid, Numbers, ProceduralShapes, union

SPANS = {
    "length": Span(0.34, 0.50, "half the length of the body"),
    "depth": Span(0.20, 0.30, "half its height"),
    "plump": Span(0.80, 1.05, "its width as a share of its height"),
    "pitch": Span(0.15, 0.95, "how far the breast is lifted, radians"),
    "neck": Span(0.06, 0.34, "from the breast to the head"),
    "head": Span(0.13, 0.19, "radius of the head"),
    "beak": Span(0.08, 0.30, "length of the beak"),
    "hook": Span(-0.35, 0.10, "how far the beak points up, in its lengths"),
    "tail": Span(0.22, 0.48, "length of the tail"),
    "fan": Span(0.06, 0.20, "half the width of the tail"),
    "cocked": Span(-0.25, 0.45, "how far the tail points up, in its lengths"),
    "spread": Span(-0.70, 0.60, "how far the wings are open; folded if negative"),
    "legs": Span(0.16, 0.40, "length of the legs"),
    "shank": Span(0.035, 0.055, "radius of the legs"),
}


def build_birds(p: Numbers, grid: Grid) -> Tensor:
    """Coverage (B, N, N, N) of given numbers."""
    sine, cosine = torch.sin(p["pitch"]), torch.cos(p["pitch"])
    floor = (p["legs"] - p["neck"] * 0.6 - 0.25) * 0.5  # so that legs and head are about as far from the middle
    body = grid.ellipsoid((0.0, floor, 0.0), (p["depth"] * p["plump"], p["depth"], p["length"]), p["pitch"])
    breast = (0.0, floor + 0.75 * p["length"] * sine, 0.75 * p["length"] * cosine)
    head = (0.0, breast[1] + 0.10 + p["neck"], breast[2] + 0.10 + 0.15 * p["neck"])
    neck = grid.rod(breast, head, 0.75 * p["depth"], 0.85 * p["head"])
    skull = grid.ellipsoid(head, (p["head"] * 0.9, p["head"], p["head"] * 1.1))
    tip = (0.0, head[1] + p["hook"] * p["beak"] - 0.02, head[2] + p["head"] + p["beak"])
    beak = grid.rod((0.0, head[1] - 0.02, head[2] + 0.5 * p["head"]), tip, 0.45 * p["head"], 0.03)
    return union(body, neck, skull, beak, _tail(p, grid, floor), _wings(p, grid, floor), _legs(p, grid, floor))


def _tail(p: Numbers, grid: Grid, floor: Tensor) -> Tensor:
    rump = (floor - 0.8 * p["length"] * torch.sin(p["pitch"]), -0.8 * p["length"] * torch.cos(p["pitch"]))
    pitch = 0.5 * p["pitch"] - p["cocked"]  # its +z end is the rump
    reach = 0.5 * p["tail"]
    middle = (0.0, rump[0] - reach * torch.sin(pitch), rump[1] - reach * torch.cos(pitch))
    return grid.ellipsoid(middle, (p["fan"], torch.full_like(reach, 0.055), reach + 0.14), pitch)


def _wings(p: Numbers, grid: Grid, floor: Tensor) -> Tensor:
    """Long flat ellipsoids along the body; open ones reach out to the sides."""
    open_ = p["spread"].clamp(min=0)
    out = p["depth"] * p["plump"] + 0.45 * open_
    half = 0.06 + 0.55 * open_
    level = floor + 0.05 + 0.1 * open_
    return grid.ellipsoid(
        (out - 0.03, level, -0.08), (half, 0.07 + 0.12 * (open_ == 0), 0.75 * p["length"]), p["pitch"]
    )


def _legs(p: Numbers, grid: Grid, floor: Tensor) -> Tensor:
    hip, aside = floor - 0.5 * p["depth"], 0.5 * p["depth"]
    foot = floor - p["depth"] - p["legs"]
    leg = grid.rod((aside, hip, 0.0), (aside, foot, 0.0), 1.3 * p["shank"], p["shank"])
    return union(leg, grid.rod((aside, foot, -0.05), (aside, foot, 0.12), p["shank"]))


birds = ProceduralShapes("birds", SPANS, build_birds)
