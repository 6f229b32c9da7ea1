"""Set the size of each arm: minutes on two CPU cores, or the paper's sizes on a GPU."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .figure import Arm, Budget

MINUTES = 9.0
"""Of training in the cpu budget; with its start and its scores an arm takes about ten."""
PREDICTOR = {"predictor_steps": 200, "predictor_images": 2048}
"""Of the paper's view predictor in the cpu budget; the released code has 100,000 and 65,536."""

SIZES: Mapping[Budget, Mapping[str, Mapping[str, Any]]] = {
    "cpu": {
        "shapes": {"size": 32, "minutes": MINUTES},
        "shapes-paper": {
            "size": 32,
            "channels": 32,
            "discriminator_channels": 16,
            "batch": 8,
            **PREDICTOR,
            "minutes": MINUTES,
        },
        "digits": {"size": 32, "minutes": MINUTES},
        "digits-paper": {"size": 32, "channels": 128, "discriminator_channels": 16, "minutes": MINUTES},
        **dict.fromkeys(("wood", "metal", "plastic", "correlated"), {"size": 64, "minutes": MINUTES}),
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
"""Flags of each recipe. In the cpu budget the paper's recipes are smaller, equally in all arms of a figure."""
OF_ARMS: Mapping[Budget, Mapping[str, Mapping[str, Any]]] = {"cpu": {"digits-predicted-paper": PREDICTOR}, "gpu": {}}
"""Flags of single arms, where not all arms of a recipe take them."""


def flags_of(arm: Arm, budget: Budget) -> dict[str, Any]:
    """Return the flags of an arm: those of its recipe in this budget, and its own."""
    return {**SIZES[budget][arm.recipe], **OF_ARMS[budget].get(arm.name, {}), **arm.flags}
