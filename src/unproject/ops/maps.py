"""Maps of a material as one tensor (B, 8, H, W), or (B, 10, H, W) if its specular albedo is coloured.

Channels: diffuse albedo k_d (3: red, green, blue), specular albedo k_s (1, or 3 as of gold and copper), roughness m (1,
the RMS slope of Beckmann's distribution), unit normal n (3: x right, y up in the picture, z out of the surface). All
values linear. The number of channels alone says which it is (`places`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias

import torch
from torch import Tensor

from .._types import UserError
from .lengths import length, unit

MapName: TypeAlias = Literal["diffuse", "specular", "roughness", "normal"]
CHANNELS, COLOURED = 8, 10
"""Channels of a material, and of one whose specular albedo is coloured."""
LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue: ITU-R BT.709."""

UNIT = 0.02  # tolerance of the length of a normal: the error of 8 bits a component


def places(channels: int = CHANNELS) -> dict[str, slice]:
    """Return where the maps are among 8 channels, or among the 10 of a coloured specular albedo.

    Examples:
        >>> places(10)["specular"]
        slice(3, 6, None)
    """
    assert channels in (CHANNELS, COLOURED)
    rough = channels - 4
    return {
        "diffuse": slice(0, 3),
        "specular": slice(3, rough),
        "roughness": slice(rough, rough + 1),
        "normal": slice(rough + 1, channels),
    }


MAPS = places()
"""Where the maps are of a material whose specular albedo is not coloured; and their names."""


def specular_channels(x: Tensor) -> int:
    """Return the number of channels, 1 or 3, of the specular albedo of maps (B, 8 or 10, H, W)."""
    return unpack_maps(x)["specular"].shape[1]


def with_specular(x: Tensor, channels: int) -> Tensor:
    """Return maps whose specular albedo has 1 channel, the luminance of 3, or 3, all equal to the 1; or x as it is."""
    if specular_channels(x) == channels:
        return x
    maps = unpack_maps(x)
    one = luminance(maps["specular"]) if channels == 1 else maps["specular"].expand(-1, channels, -1, -1)
    return pack_maps({**maps, "specular": one})


def of_colour(x: Tensor, k: int) -> Tensor:
    """Return the maps (B, 8, H, W) that reflect light of one colour: k_s is that of red (k = 0), green or blue.

    Maps of one specular channel are returned as they are.
    """
    if specular_channels(x) == 1:
        return x
    maps = unpack_maps(x)
    return pack_maps({**maps, "specular": maps["specular"][:, k : k + 1]})


def luminance(colour: Tensor) -> Tensor:
    """Return the luminance (..., 1, H, W) of linear colours (..., 3, H, W)."""
    return (colour * colour.new_tensor(LUMINANCE)[:, None, None]).sum(-3, keepdim=True)


def slopes_of(height: Tensor) -> tuple[Tensor, Tensor]:
    """Return h_x (to the right) and h_y (up) of a periodic height (..., H, W) in texels, by central differences."""
    return (height.roll(-1, -1) - height.roll(1, -1)) / 2, (height.roll(1, -2) - height.roll(-1, -2)) / 2


def normals_of(height: Tensor) -> Tensor:
    """Return unit normals (-h_x, -h_y, 1) / |…|, (B, 3, H, W), of a periodic height (B, H, W) in texels."""
    h_x, h_y = slopes_of(height)
    return unit(torch.stack([-h_x, -h_y, torch.ones_like(h_x)], 1), 1)


def pack_maps(maps: Mapping[str, Tensor]) -> Tensor:
    """Concatenate the four maps, (B, C, H, W) each, into one tensor (B, 8, H, W), or (B, 10, H, W).

    Raises:
        UserError: for a map that is missing, has the wrong number of channels, or another size.

    Examples:
        >>> import torch
        >>> maps = {name: torch.zeros(2, place.stop - place.start, 4, 4) for name, place in places(10).items()}
        >>> pack_maps(maps).shape
        torch.Size([2, 10, 4, 4])
    """
    missing = [name for name in MAPS if name not in maps]
    if missing:
        raise UserError(f"maps: {', '.join(missing)} missing; give {', '.join(MAPS)}")
    for name, place in MAPS.items():
        shape, wanted = tuple(maps[name].shape), place.stop - place.start
        allowed = (1, 3) if name == "specular" else (wanted,)
        if len(shape) != 4 or shape[1] not in allowed:
            coloured = ", or (N, 3, H, W) if it is coloured" if name == "specular" else ""
            raise UserError(f"map {name!r}: give (N, {wanted}, H, W){coloured}, not {shape}")
        if maps[name].shape[0] != maps["diffuse"].shape[0] or maps[name].shape[2:] != maps["diffuse"].shape[2:]:
            raise UserError(
                f"map {name!r} is {shape} but diffuse is {tuple(maps['diffuse'].shape)}; "
                "give all maps in one number and size"
            )
    return torch.cat([maps[name] for name in MAPS], 1)


def unpack_maps(x: Tensor) -> dict[str, Tensor]:
    """Split (B, 8, H, W), or (B, 10, H, W), into the four maps by name.

    Raises:
        UserError: for another shape.
    """
    if not are_maps(x):
        shapes = f"(B, {CHANNELS}, H, W), or (B, {COLOURED}, H, W) if the specular albedo is coloured"
        raise UserError(f"maps: give {shapes}, not {tuple(x.shape)}")
    return {name: x[:, place] for name, place in places(x.shape[1]).items()}


def are_maps(x: Tensor) -> bool:
    """Whether a tensor has the shape of maps: (B, 8, H, W) or (B, 10, H, W)."""
    return x.dim() == 4 and x.shape[1] in (CHANNELS, COLOURED)


def check_maps(x: Tensor, source: str = "maps") -> Tensor:
    """Return x (B, 8 or 10, H, W) unchanged if its values are those of a material.

    Args:
        x: maps.
        source: where they come from, for the message.

    Raises:
        UserError: for values that are not finite, a negative albedo, a roughness that is not positive, or a normal that
            is not of unit length or points into the surface.
    """
    maps = unpack_maps(x)
    for name, value in maps.items():
        if not value.isfinite().all():
            raise UserError(f"{source}: {name} has values that are NaN or infinite; fix or leave out that material")
        if name in ("diffuse", "specular") and value.min() < 0:
            raise UserError(f"{source}: {name} is negative ({value.min():.3g}); an albedo is at least 0")
        if name == "roughness" and value.min() <= 0:
            raise UserError(f"{source}: roughness is {value.min():.3g} somewhere; give positive values, 0.001 or more")
    normal = maps["normal"]
    off = (length(normal, 1) - 1).abs().max()
    if off > UNIT:
        raise UserError(
            f"{source}: normals are not of unit length (off by {off:.3g}); give components in [-1, 1], x right, y up, "
            "z out of the surface, and no zeros"
        )
    if normal[:, 2].min() <= 0:
        raise UserError(
            f"{source}: a normal points into the surface (z = {normal[:, 2].min():.3g}); z must be positive"
        )
    return x
