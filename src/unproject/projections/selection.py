"""One map of a material, as it is: what an artist's collection of albedos or normals shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from .._types import UserError
from ..ops.maps import MAPS, pack_maps, unpack_maps
from .base import Projection
from .observation import Observation
from .priors import Product


@dataclass(frozen=True)
class Selection(Projection):
    """y = one map of (B, 8, H, W): diffuse (B, 3, H, W), specular (B, 1, …), roughness (B, 1, …) or normal (B, 3, …).

    Raises:
        UserError: for another name, or what are not maps.
    """

    map: str
    linear: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.map not in MAPS:
            raise UserError(f"Selection({self.map!r}): give one of {', '.join(MAPS)}")

    def forward(self, x: Tensor | Mapping[str, Tensor]) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return unpack_maps(as_maps(x))[self.map]


def selections() -> tuple[Observation, ...]:
    """The four, each an observation of its own name."""
    return tuple(Observation(name, Selection(name), Product()) for name in MAPS)


def as_maps(x: Tensor | Mapping[str, Tensor]) -> Tensor:
    """Maps as a tensor (B, 8, H, W), or by name as `unproject sample` writes them."""
    parts = [*x.values()] if isinstance(x, Mapping) else [x]
    if not all(isinstance(part, Tensor) and part.is_floating_point() for part in parts):
        raise UserError("maps: give float tensors of linear values; eight-bit pictures are decoded first")
    return pack_maps(x) if isinstance(x, Mapping) else x
