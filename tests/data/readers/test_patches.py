"""Patches of materials: turned normals stay normals of the same surface, sizes and means hold."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from unproject._types import UserError
from unproject.data import material_patches
from unproject.ops.maps import unpack_maps, with_specular


def surface(size: int = 96) -> Tensor:
    """One material whose height is smooth, and whose specular albedo is that height: normals can be checked by it."""
    at = (torch.arange(size) * 2 + 1 - size) / size
    x, y = at.expand(size, size), -at[:, None].expand(size, size)
    height = 0.5 + 0.2 * torch.sin(3 * x + 1) * torch.cos(2 * y - 0.5)
    slope_x = 0.6 * torch.cos(3 * x + 1) * torch.cos(2 * y - 0.5)
    slope_y = -0.4 * torch.sin(3 * x + 1) * torch.sin(2 * y - 0.5)
    normal = torch.stack([-slope_x, -slope_y, torch.ones_like(x)])
    maps = torch.empty(1, 8, size, size)
    maps[0, :3], maps[0, 3], maps[0, 4] = x / 4 + 0.5, height, 0.3
    maps[0, 5:] = normal / normal.norm(dim=0)
    return maps


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("side", [0.3, 0.6])
def test_normals_turn_with_the_surface(side: float, channels: int) -> None:
    """The slope of a patch's own height, by differences over its pixels, is that of its normals."""
    patches = material_patches(with_specular(surface(), channels), 24, 32, 1, side, side)
    pixel = 2 * side / 32
    height, normal = patches[:, 3], unpack_maps(patches)["normal"]
    slope_x = (height[:, 1:-1, 2:] - height[:, 1:-1, :-2]) / (2 * pixel)
    slope_y = (height[:, :-2, 1:-1] - height[:, 2:, 1:-1]) / (2 * pixel)
    inner = normal[:, :, 1:-1, 1:-1]
    torch.testing.assert_close(-inner[:, 0] / inner[:, 2], slope_x, atol=0.03, rtol=0)
    torch.testing.assert_close(-inner[:, 1] / inner[:, 2], slope_y, atol=0.03, rtol=0)
    directions = torch.atan2(inner[:, 1].mean((1, 2)), inner[:, 0].mean((1, 2)))
    assert directions.std() > 0.5  # and they are not all turned alike


def test_a_patch_is_a_function_of_its_number() -> None:
    source = surface().repeat(3, 1, 1, 1) * torch.tensor([1.0, 0.5, 0.25])[:, None, None, None].pow(
        torch.tensor([1.0, 1, 1, 1, 0, 0, 0, 0])[:, None, None]
    )
    many, few = material_patches(source, 12, 16, 5), material_patches(source, 4, 16, 5)
    assert torch.equal(many[:4], few)
    assert not torch.equal(many, material_patches(source, 12, 16, 6))
    brightness = many[:, 3].mean((1, 2))
    assert brightness.max() > 1.8 * brightness.min()  # of different materials


def test_shrinking_averages() -> None:
    """A chessboard of pixels, eight times smaller: grey, not a pattern of its own."""
    board = surface(256)
    board[:, :3] = ((torch.arange(256)[:, None] + torch.arange(256)) % 2).float()
    patches = material_patches(board, 6, 16, 0, 0.5, 0.5)
    torch.testing.assert_close(patches[:, :3], torch.full((6, 3, 16, 16), 0.5), atol=0.02, rtol=0)


@pytest.mark.parametrize("options", [{"count": 0}, {"count": 2, "largest": 0.9}, {"count": 2, "smallest": 0.0}])
def test_what_does_not_fit_is_refused(options: dict[str, float]) -> None:
    with pytest.raises(UserError, match="patches"):
        material_patches(surface(32), **options)  # pyright: ignore[reportArgumentType]
    assert material_patches(surface(32), 1, 8, largest=0.99, turn=0.0).shape == (1, 8, 8, 8)
