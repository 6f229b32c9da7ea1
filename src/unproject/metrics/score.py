"""Score: a number with the protocol of its measurement.

Only scores with equal protocols are comparable.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Score:
    """The value of one metric, as `unproject evaluate --json` prints it.

    Attributes:
        value: the number.
        protocol: all it depends on besides the data: distance, threshold, set sizes, gauge, points.
        n: number of generated or predicted items that were scored.
        seed: of the random draws of the measurement; 0 if it draws nothing.

    Examples:
        >>> import unproject as up
        >>> up.metrics.Score(0.31, "mmd(1-iou), 32^3 at 0.5, 100 generated vs 100 reference", n=100).value
        0.31
    """

    value: float
    protocol: str
    n: int
    seed: int = 0
