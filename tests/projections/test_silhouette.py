"""Silhouettes: areas of discs, orientation of pictures, the fast path, the sets of views."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
import torch.nn.functional as F

from unproject._random import generator_at
from unproject._types import UserError
from unproject.assignment.views import views_of
from unproject.data import Collection, chairs
from unproject.ops import rotate, visual_hull
from unproject.ops.resampling import centres
from unproject.projections.silhouette import (
    CAMERAS,
    RULES,
    Silhouette,
    azimuth_bins,
    azimuth_elevation_bins,
    mirrored_views,
)

AZIMUTHS = torch.tensor([0, 0.3, math.pi / 4, 1.9, math.pi, 5.0])


def ball(size: int, radius: float) -> torch.Tensor:
    """(1, N, N, N) a ball that fades to 0 over its outermost voxel: a grazing ray adds up all that is in its way."""
    axes = torch.meshgrid(*[centres(size, torch.empty(0))] * 3, indexing="ij")
    distance = torch.stack(axes).norm(dim=0)
    return ((radius - distance) * size / 2).clamp(0, 1)[None]


def area(picture: torch.Tensor, viewport: float) -> torch.Tensor:
    """The area of what is more than half covered, in world units, of each picture."""
    return (picture > 0.5).float().mean((1, 2, 3)) * (2 * viewport) ** 2


def disc(radius: float, camera: str, distance: float) -> float:
    """The area of a ball's silhouette in the central plane: a pinhole sees the section of the tangent cone."""
    seen = radius if camera == "orthographic" else radius * distance / math.sqrt(distance**2 - radius**2)
    return math.pi * seen**2


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("rule", ["any", "absorption"])
@pytest.mark.parametrize("elevation", [0.0, 0.4, -1.2, math.pi / 2])
def test_a_ball_is_a_disc_of_the_right_area_from_everywhere(rule: str, camera: str, elevation: float) -> None:
    """Absorption blurs the rim; at density 1 its half-way line lies on it."""
    silhouette = Silhouette(size=64, rule=rule, camera=camera, viewport=1.2, density=1)
    x = ball(64, 0.8).expand(len(AZIMUTHS), -1, -1, -1)
    y = silhouette(x, azimuth=AZIMUTHS, elevation=torch.full_like(AZIMUTHS, elevation))
    measured = area(y, 1.2) / disc(0.8, camera, silhouette.distance)
    assert measured.min() > 0.98 and measured.max() < 1.02


@pytest.mark.parametrize("elevation", [0.0, math.pi / 2])
def test_the_released_alpha_rule_sees_the_disc_along_the_axes(elevation: float) -> None:
    """Elsewhere the rule drops the rims that METHOD's formula drops (`ops.capped_sum`): a ball then has grey rings."""
    x = (ball(48, 0.7) > 0).float().expand(4, -1, -1, -1)
    azimuth = torch.arange(4) * math.pi / 2
    y = Silhouette(rule="alpha")(x, azimuth=azimuth, elevation=torch.full((4,), elevation))
    torch.testing.assert_close(area(y, 1.0), torch.full((4,), disc(0.7, "orthographic", 0)), rtol=0.02, atol=0)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("camera", CAMERAS)
def test_the_alpha_rule_and_the_others_never_see_beyond_the_disc(rule: str, camera: str) -> None:
    x = ball(32, 0.5).expand(len(AZIMUTHS), -1, -1, -1)
    y = Silhouette(rule=rule, camera=camera, viewport=1.0)(x, azimuth=AZIMUTHS, elevation=AZIMUTHS / 4)
    pixel = centres(32, x)
    outside = (pixel[:, None] ** 2 + pixel**2).sqrt() > 0.5 * 4 / math.sqrt(16 - 0.25) + 3.5 / 32
    assert y[:, 0, outside].abs().max() < 1e-5


def test_perspective_tends_to_orthographic() -> None:
    x = ball(16, 0.5)
    flat = Silhouette(rule="absorption", fast=False)
    far = Silhouette(rule="absorption", camera="perspective", distance=1e5)
    a, e = torch.tensor([0.4]), torch.tensor([0.2])
    torch.testing.assert_close(far(x, azimuth=a, elevation=e), flat(x, azimuth=a, elevation=e), atol=1e-3, rtol=0)


def test_what_is_nearer_looks_larger_in_perspective() -> None:
    x = torch.zeros(1, 24, 24, 24)
    x[:, 10:14, 10:14, 20:] = 1
    silhouette = Silhouette(camera="perspective", distance=3)
    front, back = silhouette(x.expand(2, -1, -1, -1), azimuth=torch.tensor([0, math.pi]), elevation=None)
    assert front.sum() > 1.5 * back.sum()


def letter() -> torch.Tensor:
    """(1, 8, 8, 8) an L that stands in the plane z = high: stem at low x, foot to +x, its far side empty."""
    x = torch.zeros(1, 8, 8, 8)
    x[0, 1, 1:7, 6] = 1
    x[0, 1:5, 1, 6] = 1
    return x


def picture_of(azimuth: float, elevation: float = 0.0, **options: Any) -> torch.Tensor:
    silhouette = Silhouette(**options)
    return silhouette(letter(), azimuth=torch.tensor([azimuth]), elevation=torch.tensor([elevation]))[0, 0]


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("rule", ["any", "alpha"])
def test_azimuth_zero_looks_along_minus_z_with_x_to_the_right_and_row_zero_on_top(rule: str, fast: bool) -> None:
    expected = torch.zeros(8, 8)
    expected[1:7, 1] = 1  # the stem: rows from the top
    expected[6, 1:5] = 1  # the foot, in the last but one row, to the right
    torch.testing.assert_close(picture_of(0, rule=rule, fast=fast), expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(picture_of(math.pi, rule=rule, fast=fast), expected.flip(1), atol=1e-5, rtol=0)


@pytest.mark.parametrize("fast", [True, False])
def test_azimuth_ninety_puts_plus_z_to_the_left(fast: bool) -> None:
    """From +x one looks along -x: right is -z, so the L, a plane at z = high, is one column on the left."""
    expected = torch.zeros(8, 8)
    expected[1:7, 1] = 1
    torch.testing.assert_close(picture_of(math.pi / 2, fast=fast), expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(picture_of(-math.pi / 2, fast=fast), expected.flip(1), atol=1e-5, rtol=0)


def test_from_the_top_minus_z_is_up_in_the_picture() -> None:
    expected = torch.zeros(8, 8)
    expected[6, 1:5] = 1
    torch.testing.assert_close(picture_of(0, math.pi / 2), expected, atol=1e-5, rtol=0)


def test_opposite_views_are_mirror_images() -> None:
    x = torch.rand(5, 12, 12, 12, generator=generator_at(0)) ** 4
    azimuth = torch.rand(5, generator=generator_at(1)) * 7
    for rule in ("any", "absorption"):
        silhouette = Silhouette(rule=rule)
        opposite = silhouette(x, azimuth=azimuth + math.pi, elevation=None).flip(3)
        torch.testing.assert_close(silhouette(x, azimuth=azimuth, elevation=None), opposite, atol=1e-4, rtol=0)


def test_at_viewport_one_it_is_the_rule_along_the_turned_volume() -> None:
    """Nothing but `rotate` and the formula, for a shape that keeps clear of the corners that `rotate` cuts."""
    x = ball(16, 0.6) * torch.rand(1, 16, 16, 16, generator=generator_at(0))
    a, e = torch.tensor([0.7]), torch.tensor([0.3])
    expected = 1 - (1 - rotate(x, a, e)).prod(3)
    y = Silhouette(fast=False)(x, azimuth=a, elevation=e)
    torch.testing.assert_close(y[0, 0], expected[0].T.flip(0), atol=1e-4, rtol=0)


OPTIONS = [
    {},
    {"viewport": 1.4},
    {"size": 11, "viewport": 0.7},
    {"size": 40, "depth_samples": 7},
    {"depth_samples": 96},
]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("rule", RULES)
def test_the_fast_path_is_the_reference_in_values_and_gradients(rule: str, options: dict[str, Any]) -> None:
    x = (torch.rand(4, 12, 10, 14, generator=generator_at(0)) ** 3).double()
    azimuth = torch.rand(4, generator=generator_at(1)).double() * 7
    results = []
    for fast in (True, False):
        v = x.clone().requires_grad_()
        y = Silhouette(rule=rule, fast=fast, **options)(v, azimuth=azimuth, elevation=torch.zeros(4))
        weight = torch.rand(y.shape, generator=generator_at(2), dtype=y.dtype)
        results.append((y, *torch.autograd.grad(y, v, weight)))
    for quick, plain in zip(*results):
        torch.testing.assert_close(quick, plain, atol=1e-9, rtol=1e-7)


def test_the_fast_path_in_single_precision() -> None:
    x = (torch.rand(2, 32, 32, 32, generator=generator_at(0)) < 0.05).float()
    azimuth = torch.tensor([0.4, 3.0])
    for rule in ("any", "absorption"):
        quick, plain = (Silhouette(rule=rule, fast=fast)(x, azimuth=azimuth) for fast in (True, False))
        torch.testing.assert_close(quick, plain, atol=1e-4, rtol=0)


def solids(name: str, size: int = 32) -> torch.Tensor:
    """(12, N, N, N): chairs, or smooth random blobs."""
    if name == "chairs":
        return chairs(12, size).float()
    coarse = torch.rand(12, 1, 6, 6, 6, generator=generator_at(0))
    return F.interpolate(coarse, size=(size,) * 3, mode="trilinear")[:, 0] ** 4


def views(low: float, high: float, count: int = 12) -> dict[str, torch.Tensor]:
    """Azimuths all around, elevations between two angles in degrees, up and down in turn."""
    azimuth, part = torch.rand(2, count, generator=generator_at(1))
    elevation = torch.deg2rad(low + (high - low) * part)
    return {"azimuth": azimuth * 2 * math.pi, "elevation": elevation * torch.tensor([1, -1]).repeat(count // 2)}


MEANS = {
    ("chairs", "any"): 0.008,
    ("chairs", "alpha"): 0.03,
    ("chairs", "absorption"): 0.008,
    ("blobs", "any"): 0.008,
    ("blobs", "alpha"): 0.05,
    ("blobs", "absorption"): 0.004,
}
"""The largest mean difference of tilted views from the reference, for solids and rules."""


@pytest.mark.parametrize("solid, rule", MEANS)
@pytest.mark.parametrize("low, high", [(0, 30), (30, 60), (60, 90)])
def test_tilted_views_are_nearly_the_reference(solid: str, rule: str, low: float, high: float) -> None:
    x, theta = solids(solid), views(low, high)
    quick, plain = (Silhouette(rule=rule, fast=fast)(x, **theta) for fast in (True, False))
    difference = (quick - plain).abs()
    assert difference.mean() < MEANS[solid, rule] and difference.mean((1, 2, 3)).max() < 3 * MEANS[solid, rule]
    assert rule == "alpha" or (difference > 0.25).float().mean() < (1e-3 if high <= 60 else 6e-3)
    assert rule == "alpha" or low > 0 or difference.max() < 0.25


@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_gradients_of_tilted_views_point_where_the_reference_does(rule: str) -> None:
    """For solids that keep clear of the box's corners, which the reference cuts off 1.5 from the centre."""
    x, theta = solids("blobs") * ball(32, 0.9), views(0, 60)
    gradients = []
    for fast in (True, False):
        v, e = x.clone().requires_grad_(), theta["elevation"].clone().requires_grad_()
        y = Silhouette(rule=rule, fast=fast)(v, azimuth=theta["azimuth"], elevation=e)
        loss = (y * F.interpolate(torch.rand(12, 1, 4, 4, generator=generator_at(2)), size=y.shape[2:])).sum()
        gradients.append(torch.autograd.grad(loss, (v, e)))
    for quick, plain in zip(*gradients):
        assert F.cosine_similarity(quick.flatten(), plain.flatten(), 0) > 0.97
        assert 0.95 < quick.norm() / plain.norm() < 1.05


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("rule", RULES)
def test_tilted_views_tend_to_level_ones(rule: str, options: dict[str, Any]) -> None:
    """An elevation that requires a gradient takes the path of tilted views, also where it is 0."""
    x = (torch.rand(3, 12, 10, 14, generator=generator_at(0)) ** 3).double()
    azimuth = torch.rand(3, generator=generator_at(1)).double() * 7
    silhouette = Silhouette(rule=rule, **options)
    level = silhouette(x, azimuth=azimuth)
    tilted = silhouette(x, azimuth=azimuth, elevation=torch.zeros(3).double().requires_grad_())
    torch.testing.assert_close(tilted, level, atol=1e-9, rtol=0)
    assert tilted.requires_grad


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("elevation", [-math.pi / 2, math.pi / 2])
def test_from_the_top_and_from_below_it_is_the_reference(rule: str, elevation: float) -> None:
    x = (torch.rand(4, 12, 12, 12, generator=generator_at(0)) ** 3).double()
    theta = {"azimuth": torch.arange(4) * math.pi / 2, "elevation": torch.full((4,), elevation)}
    quick, plain = (Silhouette(rule=rule, fast=fast)(x, **theta) for fast in (True, False))
    torch.testing.assert_close(quick, plain, atol=1e-5, rtol=0)


@pytest.mark.parametrize("rule", RULES)
def test_a_batch_may_mix_level_and_tilted_views_and_be_seen_in_parts(
    rule: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    x, silhouette = solids("blobs", 12)[:5], Silhouette(rule=rule)
    theta = {"azimuth": torch.arange(5.0), "elevation": torch.tensor([0, 0.4, 0, -1.0, 1.5])}
    together = silhouette(x, **theta)
    alone = [silhouette(x[k : k + 1], **{name: value[k : k + 1] for name, value in theta.items()}) for k in range(5)]
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-5, rtol=0)
    monkeypatch.setattr("unproject.projections.silhouette._CACHED", 2 * 12 * 18 * 12)
    torch.testing.assert_close(silhouette(x, **theta), together, atol=1e-6, rtol=0)


@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_tilted_views_are_differentiable_in_the_volume_and_the_elevation(rule: str) -> None:
    x = torch.rand(2, 5, 4, 5, generator=generator_at(0)).double().requires_grad_()
    e = torch.tensor([0.3, -1.2], dtype=torch.float64, requires_grad=True)
    silhouette, azimuth = Silhouette(rule=rule, size=4, depth_samples=6), torch.tensor([0.3, 2.0])
    assert torch.autograd.gradcheck(lambda x, e: silhouette(x, azimuth=azimuth, elevation=e), (x, e))


def test_differentiable_in_the_view() -> None:
    x = (torch.rand(1, 5, 5, 5, generator=generator_at(0))).double()
    a, e = (torch.tensor([v], dtype=torch.float64, requires_grad=True) for v in (0.3, 0.0))
    silhouette = Silhouette(size=4, depth_samples=6)
    assert torch.autograd.gradcheck(lambda a, e: silhouette(x, azimuth=a, elevation=e), (a, e))


@pytest.mark.parametrize("camera", CAMERAS)
def test_absorption_does_not_depend_on_the_number_of_samples(camera: str) -> None:
    x = ball(16, 0.6)
    pictures = [
        Silhouette(rule="absorption", camera=camera, density=0.2, depth_samples=n)(x, azimuth=torch.tensor([0.3]))
        for n in (None, 100, 200)
    ]
    for picture in pictures[:2]:
        torch.testing.assert_close(picture, pictures[2], atol=0.01, rtol=0)


@pytest.mark.parametrize("resolution", [8, 18, 32])
def test_one_full_voxel_absorbs_by_the_density(resolution: int) -> None:
    x = torch.zeros(1, resolution, resolution, resolution)
    x[:, :, :, 3] = 1
    y = Silhouette(rule="absorption", density=2)(x, azimuth=torch.zeros(1))
    torch.testing.assert_close(y, torch.full_like(y, 1 - math.exp(-2)), atol=1e-5, rtol=0)


def test_a_slanting_ray_through_a_layer_is_absorbed_by_its_length() -> None:
    """Through a layer one voxel thick a pinhole's ray is the longer the more it slants: sqrt(1 + (i² + j²) v² / d²)."""
    x = torch.zeros(1, 8, 8, 8)
    x[..., 4] = 1
    look = Silhouette(rule="absorption", camera="perspective", density=0.7, viewport=0.7, distance=2.5)
    y = look(x, azimuth=torch.zeros(1))[0, 0]
    slope = (0.7 / 2.5 * centres(8, x)).square()
    torch.testing.assert_close(-(1 - y).log() / 0.7, (1 + slope[:, None] + slope).sqrt(), atol=1e-5, rtol=0)


def test_half_precision_volumes_are_seen_in_single_precision() -> None:
    x = torch.rand(1, 8, 8, 8, generator=generator_at(0)).bfloat16().requires_grad_()
    with torch.autocast("cpu", torch.bfloat16):
        y = Silhouette(viewport=1.3)(x, azimuth=torch.tensor([0.4]))
    y.sum().backward()
    assert y.dtype == torch.float32 and x.grad is not None and x.grad.dtype == torch.bfloat16
    torch.testing.assert_close(y, Silhouette(viewport=1.3)(x.float(), azimuth=torch.tensor([0.4])))


def test_the_hull_casts_the_same_silhouettes() -> None:
    x = (torch.rand(1, 16, 16, 16, generator=generator_at(0)) < 0.02).float()
    hull = visual_hull(x)
    silhouette = Silhouette()
    for quarter in range(4):
        azimuth = torch.tensor([quarter * math.pi / 2])
        torch.testing.assert_close(silhouette(hull, azimuth=azimuth), silhouette(x, azimuth=azimuth), atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"rule": "max"}, "unknown rule 'max'; choose one of any, alpha, absorption"),
        ({"camera": "fish"}, "unknown camera"),
        ({"viewport": 0}, "positive"),
        ({"density": -1}, "positive"),
        ({"camera": "perspective", "distance": 1.0}, "distance above 2"),
        ({"size": 0}, "at least 1"),
    ],
)
def test_bad_options_say_what_to_choose(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Silhouette(**options)


def test_bad_shapes_say_what_is_wanted() -> None:
    with pytest.raises(UserError, match=r"\(B, X, Y, Z\), not \(2, 8, 8\)"):
        Silhouette()(torch.zeros(2, 8, 8), azimuth=torch.zeros(2))
    with pytest.raises(UserError, match=r"one azimuth a volume: \(2,\), not \(3,\)"):
        Silhouette()(torch.zeros(2, 8, 8, 8), azimuth=torch.zeros(3))
    with pytest.raises(UserError, match="one elevation a volume"):
        Silhouette()(torch.zeros(2, 8, 8, 8), azimuth=torch.zeros(2), elevation=torch.zeros(1))
    with pytest.raises(TypeError, match="azimut"):
        Silhouette()(torch.zeros(2, 8, 8, 8), azimut=torch.zeros(2))


def test_sixteen_azimuth_bins() -> None:
    bins = azimuth_bins()
    assert len(bins) == 16 and len({observation.name for observation in bins}) == 16
    for k, observation in enumerate(bins):
        draws = observation.prior.sample(500, generator_at(k))
        offset = torch.rad2deg(draws["azimuth"]) - 22.5 * k
        assert offset.abs().max() <= 11.25 + 1e-3 and offset.min() < -10 and offset.max() > 10
        assert not draws["elevation"].any()


def test_twenty_four_azimuth_elevation_bins() -> None:
    bins = azimuth_elevation_bins()
    assert len(bins) == 24 and len({observation.name for observation in bins}) == 24
    elevation = torch.cat([observation.prior.sample(100, generator_at(0))["elevation"] for observation in bins[:3]])
    bands = torch.rad2deg(elevation).view(3, 100)
    for band, low in zip(bands, (-22.5, -7.5, 7.5)):
        assert band.min() >= low - 1e-3 and band.max() <= low + 15 + 1e-3


@pytest.mark.parametrize("bands", [1, 2, 3])
def test_the_outermost_elevations_are_in_a_band(bands: int) -> None:
    most = math.radians(7.5 * bands)
    known = Collection(
        torch.zeros(3, 1, 4, 4), latents={"azimuth": torch.zeros(3), "elevation": most * torch.tensor([-1, 0, 1])}
    )
    assert views_of(known, azimuth_elevation_bins(1, bands)).tolist() == [0, bands // 2, bands - 1]


@pytest.mark.parametrize("azimuths, bands", [(1, 1), (7, 1), (8, 1), (5, 3), (4, 2)])
def test_the_mirrored_view_shows_the_flipped_picture(azimuths: int, bands: int) -> None:
    """Of volumes that are symmetric about x = 0, from the middle of each bin."""
    half = torch.rand(1, 4, 8, 8, generator=generator_at(0)) ** 3
    x = torch.cat([half, half.flip(1)], 1).expand(azimuths * bands, -1, -1, -1)
    azimuth = (2 * math.pi / azimuths * torch.arange(azimuths)).repeat_interleave(bands)
    elevation = (0.3 * (torch.arange(bands) - (bands - 1) / 2)).repeat(azimuths)
    y = Silhouette(fast=False)(x, azimuth=azimuth, elevation=elevation)
    mirrored = mirrored_views(azimuths, bands)
    torch.testing.assert_close(y[list(mirrored)], y.flip(-1), atol=1e-5, rtol=0)
    assert [mirrored[k] for k in mirrored] == list(range(azimuths * bands))


def test_an_observation_projects() -> None:
    x = torch.rand(3, 8, 8, 8, generator=generator_at(0))
    assert azimuth_bins(4)[1](x, generator_at(1)).shape == (3, 1, 8, 8)


@pytest.mark.parametrize("rule", ["any", "alpha", "absorption"])
@pytest.mark.parametrize("spoilt", ["azimuth", "elevation", "roll"])
def test_a_view_that_has_broken_down_is_nan_whatever_the_camera(rule: str, spoilt: str) -> None:
    """Not an empty picture, from which nobody would see that training has diverged."""
    view = {name: torch.full((2,), 0.2) for name in ("azimuth", "elevation", "perspective", "roll")}
    view[spoilt][1] = math.nan
    y = Silhouette(rule=rule, size=8)(torch.rand(2, 8, 8, 8), **view)  # type: ignore[arg-type]
    assert y[0].isfinite().all() and y[1].isnan().all()
