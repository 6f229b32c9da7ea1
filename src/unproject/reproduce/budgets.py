"""How much of the paper's experiment an arm is: on two cores in minutes, or at full size on a GPU."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .figure import Arm, Budget

MINUTES = 9.0
"""Of training, in the cpu budget: with its start and its scores an arm takes about ten."""
STEPS = 1400
"""Of modern materials there, in all arms alike: three to nine minutes of one core that has nothing else to do."""

SIZES: Mapping[Budget, Mapping[str, Mapping[str, Any]]] = {
    "cpu": {
        "shapes": {"size": 32, "minutes": MINUTES},
        "shapes-paper": {
            "size": 32,
            "channels": 32,
            "discriminator_channels": 16,
            "batch": 8,
            "predictor_steps": 200,
            "predictor_images": 2048,
            "minutes": MINUTES,
        },
        "digits": {"size": 32, "minutes": MINUTES},
        "digits-paper": {"size": 32, "channels": 128, "discriminator_channels": 16, "minutes": MINUTES},
        **dict.fromkeys(("wood", "metal", "plastic", "correlated"), {"size": 64, "steps": STEPS}),
        **dict.fromkeys(
            ("wood-paper", "metal-paper", "plastic-paper"),
            {"size": 64, "channels": 128, "discriminator_channels": 16, "batch": 16, "samples": 8, "minutes": MINUTES},
        ),
    },
    "gpu": {
        "shapes": {"size": 64, "steps": 20_000},
        "shapes-paper": {"size": 64, "steps": 300_000},
        "digits": {"size": 32, "steps": 20_000},
        "digits-paper": {"size": 32, "steps": 100_000},
        **dict.fromkeys(("wood", "metal", "plastic", "correlated"), {"size": 64, "batch": 32, "steps": 20_000}),
        **dict.fromkeys(("wood-paper", "metal-paper", "plastic-paper"), {"size": 64, "steps": 50_000}),
    },
}
"""Flags of each recipe. Those of the paper are smaller in the cpu budget, alike in all arms of a figure, and their view
predictors, which the released code trains for 100,000 steps a round, are trained for 200."""


def flags_of(arm: Arm, budget: Budget) -> dict[str, Any]:
    return {**SIZES[budget][arm.recipe], **arm.flags}
