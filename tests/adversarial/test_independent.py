"""Independent: maps that go together cost, others do not; contrasts do not count, and at the end nothing does."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

import unproject as up
from unproject._random import generator_at
from unproject._types import UserError
from unproject.adversarial import Independent
from unproject.ops.map_bands import MEAN, map_bands
from unproject.ops.maps import pack_maps, specular_channels


def noise(seed: int, n: int = 6, size: int = 32) -> Tensor:
    return torch.rand(n, 1, size, size, generator=generator_at(seed))


def materials(diffuse: Tensor, specular: Tensor, roughness: Tensor) -> Tensor:
    """Flat materials of three fields (N, 1, H, W)."""
    normal = diffuse.new_tensor([0.0, 0.0, 1.0])[:, None, None].expand(len(diffuse), 3, *diffuse.shape[2:])
    return pack_maps(
        {
            "diffuse": diffuse.expand(-1, 3, -1, -1) * 0.5 + 0.2,
            "specular": specular * 0.3,
            "roughness": roughness * 0.5 + 0.2,
            "normal": normal,
        }
    )


def test_maps_that_go_together_cost_their_squared_correlation() -> None:
    a, b, c = noise(1), noise(2), noise(3)
    apart, one, all_of_them = materials(a, b, c), materials(a, b, b), materials(a, -a, a)
    values = [Independent(weight=6.0)(x, 0.0).item() for x in (apart, one, all_of_them)]
    assert values == pytest.approx([0.0, 1.0, 3.0], abs=0.1)  # 0, 1 and 3 of six pairs


def test_contrast_does_not_count() -> None:
    a, b = noise(1), noise(2)
    strong, weak = (materials(a, 0.5 + s * (b - 0.5), 0.5 + s * (b - 0.5)) for s in (1.0, 0.1))
    torch.testing.assert_close(Independent()(strong, 0.0), Independent()(weak, 0.0), rtol=1e-2, atol=0)


def test_its_weight_falls_to_nothing() -> None:
    b = noise(2)
    x = materials(noise(1), b, b)
    whole = Independent(until=0.5)(x, 0.0)
    falling = [(Independent(until=0.5)(x, progress) / whole).item() for progress in (0.0, 0.25, 0.5, 1.0)]
    assert falling == pytest.approx([1.0, 0.5, 0.0, 0.0])


def test_its_gradient_takes_maps_apart() -> None:
    a, b, share = noise(1), noise(2), torch.tensor(0.8, requires_grad=True)
    for _ in range(60):
        x = materials(a, share * a + (1 - share) * b, noise(3))
        (gradient,) = torch.autograd.grad(Independent()(x, 0.0), share)
        with torch.no_grad():
            share -= 0.1 * gradient
    assert share.item() < 0.3


def test_maps_without_contrast_have_a_gradient() -> None:
    x = materials(noise(1), noise(2), torch.full((6, 1, 32, 32), 0.5)).requires_grad_()
    (gradient,) = torch.autograd.grad(Independent()(x, 0.0), x)
    assert gradient.isfinite().all()


def test_a_coloured_specular_albedo_counts_as_its_luminance() -> None:
    x = up.data.metal(4, 16, 0, coloured=True)
    assert specular_channels(x) == 3
    assert Independent()(x, 0.0) > 0
    assert {scale: band.shape[1:2] for scale, band in map_bands(x).items()} == {"16": (4,), "8": (4,), MEAN: (4,)}


@pytest.mark.parametrize("settings", [{"weight": -1.0}, {"weight": math.inf}, {"until": 0.0}, {"until": 1.5}])
def test_settings_out_of_range(settings: dict[str, float]) -> None:
    with pytest.raises(UserError, match="give a weight of 0 or more, and until"):
        Independent(**settings)


def test_recipes_of_materials_prefer_it_where_maps_are_learned_apart() -> None:
    few = {"size": 16, "maps": 8, "renderings": 8, "steps": 1}
    assert up.recipes.find("wood")(**few).regulariser == Independent()
    assert up.recipes.find("wood")(**few, independent=0.5).regulariser == Independent(0.5)
    assert up.recipes.find("wood")(**few, independent=0.0).regulariser is None
    assert up.recipes.find("wood")(**few, views="direct").regulariser is None
