"""Score: a number that says how it was measured.

Two numbers may be compared only if their protocols are the same string.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Score:
    """What `unproject evaluate --json` prints for one metric.

    Attributes:
        value: the number.
        protocol: everything it depends on but the data: distance, threshold, set sizes, gauge, points.
        n: how many generated or predicted items were scored.
        seed: of the random draws of the measurement itself; 0 where it draws nothing.
    """

    value: float
    protocol: str
    n: int
    seed: int = 0
