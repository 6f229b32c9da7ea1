"""Selection of one map of a material: a collection may hold only albedos, or only normal maps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from .._types import UserError
from ..ops.maps import MAPS, MapName, pack_maps, unpack_maps
from .base import Projection


@dataclass(frozen=True)
class Selection(Projection):
    """y = one map of materials (B, 8, H, W): diffuse or normal (B, 3, H, W), specular or roughness (B, 1, H, W).

    Of materials (B, 10, H, W) the specular map is coloured, (B, 3, H, W).

    Raises:
        UserError: for another name, or an x that is not a material.

    Examples:
        >>> import torch, unproject as up
        >>> up.Selection("roughness")(torch.rand(2, 8, 16, 16)).shape
        torch.Size([2, 1, 16, 16])
    """

    map: MapName
    linear: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.map not in MAPS:
            raise UserError(f"Selection({self.map!r}): give one of {', '.join(MAPS)}")

    def forward(self, x: Tensor | Mapping[str, Tensor]) -> Tensor:
        """Return the map of x, a tensor (B, 8 or 10, H, W) or maps by name."""
        return unpack_maps(as_maps(x))[self.map]


def as_maps(x: Tensor | Mapping[str, Tensor]) -> Tensor:
    """Return maps (B, 8 or 10, H, W) of a tensor, or of the maps by name that `unproject sample` writes."""
    parts = [*x.values()] if isinstance(x, Mapping) else [x]
    if not all(isinstance(part, Tensor) and part.is_floating_point() for part in parts):
        raise UserError("maps: give float tensors of linear values; decode 8-bit pictures first")
    return pack_maps(x) if isinstance(x, Mapping) else x
