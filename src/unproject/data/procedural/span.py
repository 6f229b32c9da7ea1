"""A parameter of a procedural item."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Span:
    """A parameter drawn uniformly between low and high."""

    low: float
    high: float
    meaning: str
