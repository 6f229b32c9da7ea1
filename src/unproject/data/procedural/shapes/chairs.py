"""A procedural data set of chairs: the embedded 3-D collection.

A chair is a union of parts, each the product of two coverages that share at most one axis,

    prism  a(x, y) b(y, z)      legs, backs, arms: a cross-section that may lean or widen with height
    plate  a(x, z) b(y)         seats, cushions, star feet: an outline with a thickness

so that a thousand chairs at 32³ take about a second. Coverage is the share of a voxel inside the part
(exact for boxes), which makes the soft volumes antialiased; the hard ones are `soft > 0.5`.

Chairs stand upright (y up), face +z, are mirror images of themselves in x = 0, and their bounding box is
centred; they lie inside the cylinder of radius 0.95 about the y axis and |y| <= 0.9. Lengths are in units of the
frame [-1, 1]³ (a voxel at 32³ is 0.0625), angles in degrees; `PARAMETERS` gives their ranges.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...._random import generator_at
from ...._types import UserError
from ..span import Span

Parameters = dict[str, Tensor]

BASES = ("four legs", "sled", "pedestal", "block")
BACKS = ("solid", "vertical slats", "ladder", "panel")
REACH = 0.93
THIN = 0.11


PARAMETERS: dict[str, Span] = {
    "seat_width": Span(0.80, 1.15, "full width of the seat"),
    "seat_depth": Span(0.78, 1.05, "full depth of the seat"),
    "seat_height": Span(0.55, 0.85, "from the floor to the top of the seat"),
    "seat_thickness": Span(0.10, 0.20, "thickness of the seat"),
    "seat_roundness": Span(
        0.00, 1.00, "0 a rectangle, 1 front corners rounded by half the depth; less where legs stand"
    ),
    "cushion": Span(-0.15, 0.15, "height of a cushion on the seat; none if negative"),
    "back_height": Span(0.55, 0.95, "from the top of the seat to the top of the back"),
    "back_thickness": Span(0.11, 0.17, "thickness of the back"),
    "back_taper": Span(0.75, 1.10, "width of the back's top as a share of the seat's width"),
    "back_roundness": Span(-0.50, 1.00, "rounding of the back's upper corners; square if negative"),
    "recline": Span(0.0, 18.0, "angle of the back from upright, in degrees"),
    "slats": Span(1.0, 3.99, "number of slats or rungs, rounded down; fewer where they would touch"),
    "leg_thickness": Span(0.11, 0.18, "side of a leg's square cross-section"),
    "splay": Span(-6.0, 12.0, "angle of the legs from upright, in degrees; upright if negative"),
    "stretcher": Span(-0.60, 0.60, "height of the bars between the legs as a share of the legs'; none if negative"),
    "arm_height": Span(0.24, 0.38, "from the top of the seat to the top of the armrests"),
    "arm_thickness": Span(0.11, 0.18, "thickness of the armrests"),
    "foot_radius": Span(0.38, 0.55, "length of a star foot's arms"),
    "arms": Span(0.0, 1.0, "armrests if above 0.6 (0.25 for a block)"),
    "base": Span(0.0, 1.0, "four legs below 0.55, then sled to 0.67, pedestal to 0.85, block"),
    "back": Span(0.0, 1.0, "solid below 0.4, then vertical slats to 0.6, ladder to 0.8, panel"),
}


def chairs(count: int, resolution: int = 32, seed: int = 0, soft: bool = False, chunk: int = 128) -> Tensor:
    """The first `count` chairs of a seed: (count, N, N, N) float32 in {0, 1}, or in [0, 1] if `soft`.

    Raises:
        UserError: if `count` is below 1 or `resolution` below 8.
    """
    if count < 1 or resolution < 8:
        raise UserError(f"chairs: give a count of at least 1 (not {count}) and a resolution of 8 (not {resolution})")
    drawn = chair_parameters(count, seed)
    parts = [{name: v[i : i + chunk] for name, v in drawn.items()} for i in range(0, count, chunk)]
    return torch.cat([build_chairs(p, resolution, soft) for p in parts])


def chair_parameters(count: int, seed: int = 0) -> Parameters:
    """Parameters of the first `count` chairs of a seed: name → (count,); `PARAMETERS` has their meaning."""
    uniform = torch.rand(count, len(PARAMETERS), generator=generator_at(seed, 0, "chairs"))
    return {name: s.low + (s.high - s.low) * uniform[:, k] for k, (name, s) in enumerate(PARAMETERS.items())}


def build_chairs(parameters: Parameters, resolution: int = 32, soft: bool = False) -> Tensor:
    """The volumes (B, N, N, N) of given parameters, each a (B,) tensor under the names of `PARAMETERS`."""
    plan = _Plan(parameters, resolution)
    volume = plan.seat()
    for part in (plan.back(), plan.legs(), plan.stretchers(), plan.pedestal(), plan.armrests()):
        volume = torch.maximum(volume, part)
    return volume if soft else (volume > 0.5).float()


def base_of(parameters: Parameters) -> Tensor:
    """(B,) index into `BASES`."""
    return torch.bucketize(parameters["base"], torch.tensor([0.55, 0.67, 0.85]))


def back_of(parameters: Parameters) -> Tensor:
    """(B,) index into `BACKS`."""
    return torch.bucketize(parameters["back"], torch.tensor([0.4, 0.6, 0.8]))


class _Plan:
    """The parts of a batch of chairs on one grid. Fields: (B, 1, 1) parameters, (N,) cell centres."""

    def __init__(self, parameters: Parameters, resolution: int):
        self.p = {name: v[:, None, None] for name, v in parameters.items()}
        self.base, self.style = base_of(parameters)[:, None, None], back_of(parameters)[:, None, None]
        self._lay_out()
        centre = (2 * torch.arange(resolution) + 1 - resolution) / resolution
        self.cell = 2 / resolution / self.shrink
        self.x = centre.abs()[:, None] / self.shrink
        self.y = centre + self.height / 2
        self.z = centre / self.shrink + self.centre_z

    def _lay_out(self) -> None:
        """Extents from the floor (y = 0) up; `shrink` keeps the plan inside the cylinder."""
        p = self.p
        block = self.base == 3
        lean = torch.tan(torch.deg2rad(p["recline"]))
        self.has_arms = p["arms"] > torch.where(block, 0.25, 0.6)
        self.height = p["seat_height"] + p["back_height"]
        self.lean = lean
        self.splay = torch.tan(torch.deg2rad(p["splay"].clamp(min=0))) * (self.base == 0)
        self.half_width = p["seat_width"] / 2
        self.half_depth = p["seat_depth"] / 2
        self.leg_top = p["seat_height"] - p["seat_thickness"] / 2
        reach_x, front, rear = self._reach()
        self.centre_z = (front - rear) / 2
        self.shrink = (REACH / torch.hypot(reach_x, (front + rear) / 2)).clamp(max=1)

    def _reach(self) -> tuple[Tensor, Tensor, Tensor]:
        """How far a chair reaches to a side, to the front and to the rear."""
        p = self.p
        spread = self.splay * self.leg_top
        foot = torch.where(self.base == 2, p["foot_radius"] + THIN / 2, torch.zeros(()))
        side = self.half_width * p["back_taper"].clamp(min=1) + torch.where(self.has_arms, 0.04, 0.0)
        rear = self.half_depth + torch.maximum(self.lean * p["back_height"], spread)
        return (
            torch.maximum(torch.maximum(side, self.half_width + spread), foot),
            torch.maximum(self.half_depth + spread, foot),
            torch.maximum(rear, foot),
        )

    def seat(self) -> Tensor:
        p = self.p
        top, thickness = p["seat_height"], p["seat_thickness"]
        thickness = torch.where(self.base == 3, top, thickness)
        radius = p["seat_roundness"] * torch.minimum(self.half_width, self.half_depth) * (self.base != 3)
        on_corners = (self.base != 2) | self.has_arms
        radius = torch.where(on_corners, torch.minimum(radius, 2.4 * p["leg_thickness"]), radius)
        board = self._rounded(self.half_width, self.half_depth, radius)
        cushion = self._rounded(self.half_width - 0.06, self.half_depth - 0.06, radius + 0.08)
        raised = self._along_y(top, top + p["cushion"].clamp(min=0))
        return torch.maximum(_plate(board, self._along_y(top - thickness, top)), _plate(cushion, raised))

    def back(self) -> Tensor:
        """Outline in (x, y), by style, times a slab in z that leans back."""
        p = self.p
        above = self.y - p["seat_height"]
        outline = self._back_outline(above)
        start = -p["seat_thickness"] / 2
        inside = self._cover(above, start, p["back_height"], 2 / self.x.shape[1])
        offset = -self.half_depth - self.lean * above.clamp(min=0)
        rear = offset.transpose(1, 2)
        slab = self._cover(self.z, rear, rear + p["back_thickness"] / torch.cos(torch.deg2rad(p["recline"])))
        return _prism(outline * inside, slab)

    def _back_outline(self, above: Tensor) -> Tensor:
        p, style = self.p, self.style
        share = (above / p["back_height"]).clamp(0, 1)
        width = self.half_width * (1 + (p["back_taper"] - 1) * share)
        radius = p["back_roundness"].clamp(min=0) * 0.8 * torch.minimum(self.half_width, p["back_height"])
        drop = (above - (p["back_height"] - radius)).clamp(min=0)
        width = width - radius + (radius**2 - drop**2).clamp(min=0).sqrt()
        full = self._cover(self.x, -width, width)
        bar = THIN / self.shrink
        posts = self._cover(self.x, width - bar, width)
        rail = self._cover(above, p["back_height"] - 1.6 * bar - 0.3 * radius, p["back_height"], 2 / self.x.shape[1])
        slats = torch.maximum(self._slats(width, bar), rail * full)
        rungs = torch.maximum(posts, self._rungs(above, bar) * full)
        panel = torch.maximum(posts, self._cover(above, 0.45 * p["back_height"], p["back_height"]) * full)
        slatted = torch.where(style == 1, torch.maximum(posts, slats), torch.where(style == 2, rungs, panel))
        return torch.where((style == 0) | (self.base == 3), full, slatted)

    def _slats(self, width: Tensor, bar: Tensor) -> Tensor:
        """Vertical slats evenly spaced between the posts; x is |x|, so that each stands for a pair."""
        room = (self.half_width * 2 / (bar * 2.2)).floor() - 2
        count = torch.minimum(self.p["slats"].floor(), room).clamp(min=1)
        spacing = 2 * (width - bar / 2) / (count + 1)
        index = torch.arange(2)[:, None, None, None]
        position = spacing * (index + torch.where(count % 2 == 1, 0.0, 0.5))
        covered = self._cover(self.x, position - bar / 2, position + bar / 2)
        return (covered * (position < width - bar)).amax(0)

    def _rungs(self, above: Tensor, bar: Tensor) -> Tensor:
        """Horizontal rungs, the uppermost a rail at the top."""
        count = self.p["slats"].floor().clamp(min=2)
        spacing = self.p["back_height"] / count
        index = torch.arange(3)[:, None, None, None]
        top = self.p["back_height"] - spacing * index
        covered = self._cover(above, top - bar * 1.3, top, 2 / self.x.shape[1])
        return (covered * (index < count)).amax(0)

    def legs(self) -> Tensor:
        """Four legs; a sled's are upright and joined on the floor by a runner at each side."""
        thickness = self.p["leg_thickness"] / self.shrink
        spread = self.splay * (self.leg_top - self.y)
        outer_x, outer_z = self.half_width + spread, (self.half_depth + spread).transpose(1, 2)
        sides = self._cover(self.x, outer_x - thickness, outer_x)
        ends = self._cover(self.z.abs(), outer_z - thickness, outer_z)
        upright = self._cover(self.y, torch.zeros(()), self.leg_top, 2 / self.x.shape[1])
        runner = self._cover(self.y, torch.zeros(()), self.p["leg_thickness"], 2 / self.x.shape[1]) * (self.base == 1)
        rail = runner.transpose(1, 2) * self._cover(self.z, -self.half_depth, self.half_depth)
        return _prism(sides * upright * (self.base <= 1), torch.maximum(ends, rail))

    def stretchers(self) -> Tensor:
        """An H of bars between four legs: one at each side and one across."""
        p, bar = self.p, THIN / self.shrink
        height = p["stretcher"] * self.leg_top
        wanted = (self.base == 0) & (p["stretcher"] > 0.1)
        level = self._along_y(height, height + THIN) * wanted[:, 0]
        spread = self.splay * (self.leg_top - height)
        width, depth = self.half_width + spread, self.half_depth + spread
        sides = self._box(width - bar, width, -depth, depth)
        across = self._box(-width, width, -bar / 2, bar / 2)
        return _plate(torch.maximum(sides, across), level)

    def pedestal(self) -> Tensor:
        """A round column on a star of five arms, one of them to the front."""
        radius = 0.6 * self.p["leg_thickness"] + 0.02
        x, z = (self.x * self.shrink), ((self.z - self.centre_z) * self.shrink)
        column = self._inside(torch.hypot(x, z) - radius)
        star = self._inside(self._star(x, z) - THIN / 2)
        wanted = (self.base == 2)[:, 0]
        return torch.maximum(
            _plate(column, self._along_y(torch.zeros(()), self.leg_top) * wanted),
            _plate(star, self._along_y(torch.zeros(()), torch.tensor(THIN + 0.02)) * wanted),
        )

    def _star(self, x: Tensor, z: Tensor) -> Tensor:
        """Distance in the plan from five segments that leave the axis, 72° apart."""
        distances = []
        for k in range(3):
            east, south = math.sin(0.4 * math.pi * k), math.cos(0.4 * math.pi * k)
            along = torch.minimum((x * east + z * south).clamp(min=0), self.p["foot_radius"])
            distances.append(torch.hypot(x - along * east, z - along * south))
        return torch.stack(distances).amin(0)

    def armrests(self) -> Tensor:
        """A bar at each side with a post at its front; walls on a block."""
        p, bar = self.p, self.p["arm_thickness"] / self.shrink
        top = p["seat_height"] + p["arm_height"]
        outer = self.half_width + 0.04
        sides = self._cover(self.x, outer - bar, outer)
        front, rear = self.half_depth * 0.9, -self.half_depth - self.lean * (p["arm_height"] - p["arm_thickness"])
        solid = self.base == 3
        underside = torch.where(solid, torch.zeros(()), top - p["arm_thickness"])
        rest = self._cover(self.y, underside, top, 2 / self.x.shape[1]).transpose(1, 2)
        post = self._cover(self.y, self.leg_top, top, 2 / self.x.shape[1]).transpose(1, 2)
        ends = torch.maximum(
            rest * self._cover(self.z, torch.where(solid, -self.half_depth, rear), front),
            post * self._cover(self.z, front - bar, front),
        )
        return _prism((sides * self.has_arms).expand(-1, -1, self.x.shape[1]), ends)

    def _cover(self, centre: Tensor, low: Tensor, high: Tensor, cell: float | None = None) -> Tensor:
        """The share of each cell between low and high; a horizontal cell unless its width is given."""
        width = self.cell if cell is None else cell
        inside = torch.minimum(high, centre + width / 2) - torch.maximum(low, centre - width / 2)
        return (inside / width).clamp(0, 1)

    def _along_y(self, low: Tensor, high: Tensor) -> Tensor:
        return self._cover(self.y, low, high, 2 / self.x.shape[1])[:, 0]

    def _box(self, west: Tensor, east: Tensor, north: Tensor, south: Tensor) -> Tensor:
        return self._cover(self.x, west, east) * self._cover(self.z, north, south)

    def _inside(self, distance: Tensor) -> Tensor:
        return (0.5 - distance * self.x.shape[1] / 2).clamp(0, 1)

    def _rounded(self, half_width: Tensor, half_depth: Tensor, radius: Tensor) -> Tensor:
        """A rectangle whose front corners are rounded (the back stands on the others): (B, x, z)."""
        radius = torch.minimum(radius, torch.minimum(half_width, half_depth)) * (self.z > 0)
        dx, dz = self.x - half_width + radius, self.z.abs() - half_depth + radius
        outside = torch.hypot(dx.clamp(min=0), dz.clamp(min=0)) - radius
        return self._inside((outside + torch.maximum(dx, dz).clamp(max=0)) * self.shrink)


def _prism(side: Tensor, profile: Tensor) -> Tensor:
    """a(x, y) b(y, z) for side (B, x, y) and profile (B, y, z)."""
    return side[:, :, :, None] * profile[:, None]


def _plate(outline: Tensor, level: Tensor) -> Tensor:
    """a(x, z) b(y) for outline (B, x, z) and level (B, y)."""
    return outline[:, :, None, :] * level[:, None, :, None]
