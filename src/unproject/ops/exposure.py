"""From linear radiance to the values of a photograph, gamma 2.2 and a clamp at 1; and back from sRGB."""

from __future__ import annotations

import torch
from torch import Tensor

GAMMA = 2.2
TOE = 1e-4


def develop(radiance: Tensor, gamma: float = GAMMA) -> Tensor:
    """Compute min(L^(1/γ), 1); linear below L = 10⁻⁴, since the derivative of the root is infinite at 0.

    Examples:
        >>> import torch
        >>> develop(torch.tensor([0.0, 0.5, 2.0]))
        tensor([0.0000, 0.7297, 1.0000])
    """
    lit = radiance.clamp(min=TOE) ** (1 / gamma)
    return (lit * (radiance / TOE).clamp(0, 1)).clamp(max=1)


def linear_from_srgb(v: Tensor) -> Tensor:
    """IEC 61966-2-1: v/12.92 up to 0.04045, ((v + 0.055)/1.055)^2.4 above."""
    return torch.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
