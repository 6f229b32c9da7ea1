"""Curves: what stats.jsonl logs, as line charts in SVG."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from .contents import number

WIDTH, HEIGHT = 440, 250
LEFT, RIGHT, TOP, BOTTOM = 54, 14, 12, 44
POINTS = 240
"""Points of a curve at most: neighbours are averaged."""
MAX_VALUE = 1e30
"""Values beyond it are left out."""
SEVERAL = 3
"""Curves of lists that are drawn: the mean and the spread of a latent are two."""

Points = list[tuple[float, float]]


@dataclass(frozen=True)
class Chart:
    """One chart.

    Attributes:
        title: what is drawn.
        unit: of the vertical axis.
        curves: name → points (step, value).
        logarithmic: whether the vertical axis is, which takes values above 0.
    """

    title: str
    unit: str
    curves: dict[str, Points]
    logarithmic: bool = False


KNOWN = (
    ("Losses", "loss, log scale", {"loss_d": "discriminators", "loss_g": "generator"}, True),
    ("Gradient penalty", "penalty, log scale", {"penalty": "penalty"}, True),
    (
        "What pictures tell of their views",
        "nats",
        {"view_information": "generated pictures", "view_information_of_data": "training pictures"},
        False,
    ),
    (
        "Overfitting and augmentation",
        "0 to 1",
        {"overfitting": "overfitting of discriminators", "strength": "strength of augmentation"},
        False,
    ),
    ("Camera: elevation", "radians", {"elevation": "elevation"}, False),
    ("Camera: perspective", "1 / distance", {"perspective": "perspective"}, False),
    ("Camera: roll", "radians", {"roll": "roll"}, False),
)
"""(title, unit, key → name, logarithmic) of what training logs; other keys get a chart each."""
NO_VALUES = frozenset({"step", "seconds", "event", "round", "panel", "number", "merit", "views"})


TITLES = {"mismatch": "Mismatch of statistics"}
"""Key → title of charts of their own."""


def charts_of(lines: Sequence[dict[str, Any]], panels: Sequence[str] = ()) -> list[Chart]:
    """Return the charts of a log; steps that were done again are shown as they were done last.

    A key of a further panel ends in its number, in place of which its name among `panels` is shown.
    """
    plain = [line for line in lines if "event" not in line]
    keys = dict.fromkeys(key for line in plain for key in line if key not in NO_VALUES)
    charts = []
    for title, unit, named, logarithmic in KNOWN:
        curves = {name: points for key, text in named.items() for name, points in _curves(plain, key, text).items()}
        charts.append(_chart(title, unit, curves, logarithmic))
    rounds = [line for line in lines if line.get("event") == "assigned"]
    charts.append(_chart("View predictor", "loss, nats", _curves(rounds, "loss", "loss of each round"), False))
    known = {key for *_, named, _ in KNOWN for key in named}
    several = {key.partition("/")[0] for key in keys if "/" in key}
    for key in (key for key in keys if key not in known):
        title = _title(key, panels, several)
        charts.append(_chart(title, key.partition("/")[0], _curves(plain, key, title), False))
    return [chart for chart in charts if chart.curves]


def _title(key: str, panels: Sequence[str], several: Collection[str]) -> str:
    """Return a key's title, with the name of its panel if several log it."""
    name, _, number_of = key.partition("/")
    panel = int(number_of) if number_of.isdecimal() else 0
    known = (number_of.isdecimal() or not number_of and name in several) and panel < len(panels)
    return f"{TITLES.get(name, name)}, {panels[panel]}" if known else TITLES.get(key, key)


def _chart(title: str, unit: str, curves: dict[str, Points], logarithmic: bool) -> Chart:
    curves = {name: points for name, points in curves.items() if len(points) > 1}
    positive = all(y > 0 for points in curves.values() for _, y in points)
    if logarithmic and not positive:
        unit = unit.removesuffix(", log scale")
    return Chart(title, unit, curves, logarithmic and positive)


def _curves(lines: Iterable[dict[str, Any]], key: str, text: str) -> dict[str, Points]:
    """Return the curve of a number, or of each number of a list of them (mean and spread of a latent)."""
    found: dict[str, dict[float, float]] = {}
    for line in lines:
        value, step = line.get(key), number(line.get("step"))
        parts = value[:SEVERAL] if isinstance(value, list) else [value]
        names = [f"{text}: mean", f"{text}: spread", f"{text}: 3"] if len(parts) > 1 else [text]
        for name, part in zip(names, parts):
            y = number(part)
            if y is not None and step is not None and abs(y) < MAX_VALUE:
                found.setdefault(name, {})[step] = y
    return {name: sorted(points.items()) for name, points in found.items()}


def thinned(points: Points, most: int = POINTS) -> Points:
    """Return at most so many points: the means of equally many neighbours.

    Examples:
        >>> thinned([(0.0, 1.0), (1.0, 3.0), (2.0, 5.0), (3.0, 7.0)], most=2)
        [(0.5, 2.0), (2.5, 6.0)]
    """
    together = math.ceil(len(points) / most)
    groups = [points[i : i + together] for i in range(0, len(points), together)]
    return [(sum(x for x, _ in g) / len(g), sum(y for _, y in g) / len(g)) for g in groups]


def draw(chart: Chart) -> str:
    """Return the chart as one <figure> with an <svg>."""
    curves = {name: thinned(points) for name, points in chart.curves.items()}
    up = math.log10 if chart.logarithmic else float
    values = [up(y) for points in curves.values() for _, y in points]
    steps = [x for points in curves.values() for x, _ in points]
    low, high = _padded(min(values), max(values))
    last = max(steps) or 1.0

    def place(x: float, y: float) -> str:
        across = LEFT + x / last * (WIDTH - LEFT - RIGHT)
        return f"{across:.1f} {HEIGHT - BOTTOM - (up(y) - low) / (high - low) * (HEIGHT - TOP - BOTTOM):.1f}"

    paths = [
        f'<path class="curve c{k}" d="M{"L".join(place(x, y) for x, y in points)}"/>'
        for k, points in enumerate(curves.values())
    ]
    ends = "; ".join(f"{name} {_short(points[-1][1])}" for name, points in curves.items())
    return (
        f'<figure class="chart"><h3>{escape(chart.title)}</h3>{_legend(list(curves))}'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(f"{chart.title}: {ends} at the end")}">'
        f"{_up_axis(low, high, chart)}{_step_axis(last)}{''.join(paths)}</svg></figure>"
    )


def _legend(names: Sequence[str]) -> str:
    keys = "".join(f'<span class="key k{k}">{escape(name)}</span>' for k, name in enumerate(names))
    return f"<figcaption>{keys}</figcaption>"


def _padded(low: float, high: float) -> tuple[float, float]:
    margin = (high - low) * 0.05 or abs(high) * 0.1 or 1.0
    return low - margin, high + margin


def _up_axis(low: float, high: float, chart: Chart) -> str:
    parts = []
    for tick in _powers(low, high) if chart.logarithmic else _ticks(low, high, 5):
        y = HEIGHT - BOTTOM - (tick - low) / (high - low) * (HEIGHT - TOP - BOTTOM)
        text = _short(10**tick if chart.logarithmic else tick)
        parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>')
        parts.append(f'<text class="up" x="{LEFT - 7}" y="{y + 4:.1f}">{text}</text>')
    middle = TOP + (HEIGHT - TOP - BOTTOM) / 2
    unit = f'<text class="unit" transform="translate(13 {middle:.0f}) rotate(-90)">{escape(chart.unit)}</text>'
    return "".join(parts) + unit


def _step_axis(last: float) -> str:
    y, parts = HEIGHT - BOTTOM, [f'<path class="axis" d="M{LEFT} {HEIGHT - BOTTOM}H{WIDTH - RIGHT}"/>']
    for tick in _ticks(0, last, 5):
        x = LEFT + tick / last * (WIDTH - LEFT - RIGHT)
        end = ' class="last"' if x > WIDTH - 30 else ""
        parts.append(f'<path class="axis" d="M{x:.1f} {y}v4"/><text{end} x="{x:.1f}" y="{y + 18}">{tick:,.0f}</text>')
    return "".join(parts) + f'<text class="unit" x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 6}">steps</text>'


def _ticks(low: float, high: float, about: int) -> list[float]:
    """Return round numbers between two: multiples of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / about
    power = 10 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step + 1e-9) + 1)]


def _powers(low: float, high: float) -> list[float]:
    """Return logarithms between two of 1, 2 and 5 times powers of ten, or of the powers alone where these suffice."""
    powers = range(math.floor(low), math.ceil(high) + 1)
    ticks = [[k + math.log10(m) for k in powers for m in times] for times in ((1,), (1, 2, 5))]
    seen = [[tick for tick in some if low <= tick <= high] for some in ticks]
    return next((some for some in seen if len(some) >= 3), seen[-1] or _ticks(low, high, 4))


def _short(value: float) -> str:
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return f"{value:.0e}"
