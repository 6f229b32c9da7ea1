"""A procedural data set of cars: hatchbacks, saloons, estates, pick-ups, vans, on four wheels.

They stand upright (y up), face +z, are mirror images of themselves in x = 0, and lie inside |x|, |y|, |z| < 0.95.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..span import Span
from .solids import Grid, Numbers, ProceduralShapes, union

SPANS = {
    "kind": Span(0.0, 5.0, "hatchback, saloon, estate, pick-up, van, by its whole part"),
    "length": Span(0.78, 0.92, "half the length"),
    "width": Span(0.32, 0.42, "half the width"),
    "body": Span(0.11, 0.17, "half the height of the body without the cabin"),
    "cabin": Span(0.11, 0.17, "half the height of the cabin"),
    "wheel": Span(0.13, 0.19, "radius of the wheels"),
    "tyre": Span(0.05, 0.08, "half the width of a wheel"),
    "base": Span(0.56, 0.68, "from the middle to an axle, in half lengths"),
    "bonnet": Span(0.42, 0.62, "length of the bonnet, in half lengths"),
    "boot": Span(0.30, 0.50, "length of a saloon's boot, in half lengths"),
    "slant": Span(0.5, 1.2, "how far the windscreen leans back, in its height"),
    "rear": Span(0.1, 0.7, "how far the rear window leans forward, in its height"),
}
LOW_BONNET = (1.0, 1.0, 1.0, 1.0, 0.35)
"""Length of the bonnet by kind: a van's is short."""
TALL = (1.0, 0.9, 1.0, 1.05, 1.55)


def build_cars(p: Numbers, grid: Grid) -> Tensor:
    """Coverage (B, N, N, N) of given numbers."""
    kind = p["kind"].long().clamp(max=4)
    tall = p["cabin"] * torch.tensor(TALL)[kind]
    bonnet = p["bonnet"] * torch.tensor(LOW_BONNET)[kind] * p["length"]
    height = p["wheel"] + 2 * p["body"] + 2 * tall
    ground = -0.5 * height
    middle = ground + 0.75 * p["wheel"] + p["body"]
    body = grid.box((0.0, middle, 0.0), (p["width"], p["body"], p["length"]), (0.15, 0.1))
    # Where the cabin ends behind: at the rear, before a boot, or, a pick-up's, before the bed.
    behind = torch.stack(
        [0.04 * p["length"], p["boot"] * p["length"], 0.02 * p["length"], p["length"], 0.0 * p["length"]]
    )
    behind = behind.gather(0, kind[None])[0]
    front, back = p["length"] - bonnet, -p["length"] + behind
    lean = torch.where(kind == 1, 1.1 * p["rear"] + 0.2, torch.where(kind >= 2, 0.15 * p["rear"], p["rear"]))
    cabin = grid.box(
        (0.0, middle + p["body"] + tall - 0.01, (front + back) / 2),
        (0.88 * p["width"], tall + 0.01, (front - back) / 2),
        (p["slant"] * torch.where(kind == 4, 0.5, 1.0), lean),
    )
    axle = p["base"] * p["length"]
    wheels = [
        grid.wheel((p["width"] - 0.6 * p["tyre"], ground + p["wheel"], z), p["wheel"], p["tyre"]) for z in (axle, -axle)
    ]
    # The bed of a pick-up is hollow.
    bed = grid.box((0.0, middle + p["body"], -0.55 * p["length"]), (0.8 * p["width"], p["body"], 0.38 * p["length"]))
    return union(body * (1 - bed * (kind == 3)), cabin, *wheels)


cars = ProceduralShapes("cars", SPANS, build_cars)
