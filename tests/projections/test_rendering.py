"""Pictures of materials: the frames of the conventions, the camera's response, and the latents of each light."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

import unproject as up
from unproject._random import generator_at
from unproject._types import UserError
from unproject.data import correlated
from unproject.ops.exposure import develop
from unproject.ops.maps import check_maps, of_colour, pack_maps, unpack_maps, with_specular
from unproject.ops.microfacet import Reflection
from unproject.ops.shading import Sampling
from unproject.projections.observation import Observation
from unproject.projections.rendering import Rendering, rendering_prior
from unproject.training.description import describe


def paper(size: int = 8, white: float = 1.0) -> Tensor:
    x = torch.zeros(1, 8, size, size)
    x[:, :3], x[:, 4], x[:, 7] = white, 0.5, 1
    return x


def angle(degrees: float) -> Tensor:
    return torch.tensor([math.radians(degrees)])


def mirror(roughness: float = 0.05, size: int = 33) -> Tensor:
    x = paper(size, 0.0)
    x[:, 3], x[:, 4] = 1, roughness
    return x


def linear(lighting: str | Tensor, **options: object) -> Rendering:
    return Rendering(lighting, Reflection("albedo"), Sampling(64), developed=False, **options)  # pyright: ignore[reportArgumentType]


def test_maps_by_name_are_maps() -> None:
    x = torch.rand(2, 8, 4, 4)
    named = unpack_maps(x)
    assert torch.equal(pack_maps(named), x)
    rendering = linear("directional")
    theta = {"view": torch.zeros(2), "light": torch.full((2,), 0.3)}
    assert torch.equal(rendering(named, **theta), rendering(x, **theta))
    assert torch.equal(up.Selection("normal")(named), x[:, 5:])


def test_a_highlight_is_where_the_mirror_direction_says() -> None:
    """Seen from straight above at 4 widths, light 5° from the normal towards +x: a texel at x mirrors it into the
    camera where the camera is 5° to the other side, so x = 4 tan 5° = 0.35 widths to the right."""
    seen = linear("directional")(mirror(), view=angle(0), light=angle(5), light_azimuth=angle(0))[0, 0]
    row, column = divmod(int(seen.argmax()), 33)
    assert row == 16
    assert (column + 0.5) / 33 - 0.5 == pytest.approx(4 * math.tan(math.radians(5)), abs=1 / 33)
    seen = linear("directional")(mirror(), view=angle(0), light=angle(5), light_azimuth=angle(90))[0, 0]
    row, column = divmod(int(seen.argmax()), 33)
    assert column == 16 and row < 16  # towards +y: the upper half


def test_the_camera_stands_at_the_bottom_edge() -> None:
    """At 45° from there the light that is mirrored comes from beyond the top edge, azimuth 90°."""
    rendering, x = linear("directional"), mirror()
    opposite = rendering(x, view=angle(45), light=angle(45), light_azimuth=angle(90))[0, 0, 16, 16]
    same_side = rendering(x, view=angle(45), light=angle(45), light_azimuth=angle(-90))[0, 0, 16, 16]
    assert opposite > 100 * same_side
    turned = rendering(x, view=angle(45), view_azimuth=angle(0), light=angle(45), light_azimuth=angle(180))
    assert turned[0, 0, 16, 16].item() == pytest.approx(opposite.item(), rel=1e-4)


def test_three_coloured_lamps_are_three_pictures_by_one_lamp() -> None:
    x = torch.rand(2, 8, 4, 4) * 0.5 + 0.2
    theta = {"view": torch.full((2,), 0.1), "light": torch.tensor([0.3, 0.8])}
    around = torch.tensor([3.0, -1.0])
    seen = linear("coloured")(x, **theta, light_azimuth=around)
    for k in range(3):
        one = linear("directional")(x, **theta, light_azimuth=around + k * 2 * math.pi / 3)
        torch.testing.assert_close(seen[:, k], one[:, k], atol=1e-6, rtol=1e-5)


def coloured(count: int = 2) -> Tensor:
    """Maps of ten channels, and no two equal."""
    x = torch.rand(count, 10, 4, 4, generator=generator_at(6)) * 0.5 + 0.2
    x[:, 7:9] -= 0.45
    return x


LIT = {
    "ambient": linear("ambient"),
    "directional": linear("directional"),
    "coloured": linear("coloured"),
    "natural": linear(torch.rand(2, 3, 8, 16, generator=generator_at(7)) + 0.1),
    "paper's": Rendering("ambient", Reflection("eta"), Sampling(16, gradient="differences")),
}


def latents_of(rendering: Rendering, count: int = 2) -> dict[str, Tensor]:
    return rendering_prior(rendering, 0.4).sample(count, generator_at(8))


@pytest.mark.parametrize("name", LIT)
def test_three_equal_specular_channels_are_one(name: str) -> None:
    """Of the picture, and of its gradients: that of one channel is the sum over three."""
    rendering, one = LIT[name], of_colour(coloured(), 0)
    found = []
    for x in (one, with_specular(one, 3)):
        x = x.requires_grad_()
        seen = rendering(x, **latents_of(rendering))
        weight = torch.rand(seen.shape, generator=generator_at(9))
        found.append((seen.detach(), unpack_maps(torch.autograd.grad((seen * weight).sum(), x)[0])))
    (a, by_a), (b, by_b) = found
    torch.testing.assert_close(b, a)
    by_b["specular"] = by_b["specular"].sum(1, keepdim=True)
    for key, gradient in by_a.items():
        torch.testing.assert_close(by_b[key], gradient, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", LIT)
def test_each_colour_is_reflected_by_its_own_specular_channel(name: str) -> None:
    """Whatever the others are; in the picture and in the gradient."""
    rendering, x = LIT[name], coloured()
    theta = latents_of(rendering)
    seen = rendering(x, **theta)
    for k in range(3):
        torch.testing.assert_close(seen[:, k], rendering(of_colour(x, k), **theta)[:, k])
        leaf = x.clone().requires_grad_()
        (slope,) = torch.autograd.grad(rendering(leaf, **theta)[:, k].sum(), leaf)
        moved = [bool(slope[:, 3 + j].any()) for j in range(3)]
        assert moved == [j == k for j in range(3)]


def test_gold_is_golden() -> None:
    """A mirror of F0 (1, 0.77, 0.34) shows a white light in that colour, at normal incidence."""
    f0 = torch.tensor([1.0, 0.77, 0.34])
    x = torch.zeros(1, 10, 5, 5)
    x[:, 3:6], x[:, 6], x[:, 9] = f0.view(1, 3, 1, 1), 0.3, 1
    seen = linear("directional")(x, view=angle(0), light=angle(0), light_azimuth=angle(0))[0, :, 2, 2]
    torch.testing.assert_close(seen / seen[0], f0 / f0[0], rtol=1e-4, atol=0)


def test_coloured_lamps_tell_whether_relief_goes_with_albedo() -> None:
    """From the left in red, from the right in green and blue: what red has more of rises to the right."""
    maps = unpack_maps(correlated(8, 32, 0))
    found = []
    for lighting in ("coloured", "directional"):
        rendering = Rendering(lighting, Reflection("albedo"))
        for normal in (maps["normal"], maps["normal"].roll(1, 0)):
            theta = {"view": torch.zeros(8), "light": torch.full((8,), 0.8), "light_azimuth": torch.full((8,), math.pi)}
            seen = rendering(maps | {"normal": normal}, **theta).clamp(min=0.01).log()
            more = seen[:, 0] - seen[:, 1:].mean(1) if lighting == "coloured" else seen.mean(1)
            rising = seen.mean(1).roll(-1, 2) - seen.mean(1).roll(1, 2)
            pairs = zip(more[:, :, 1:-1].flatten(1), rising[:, :, 1:-1].flatten(1), strict=True)
            found.append(torch.stack([torch.corrcoef(torch.stack(pair))[0, 1] for pair in pairs]).mean().item())
    assert found[0] > 0.25
    assert max(abs(value) for value in found[1:]) < 0.1


def test_normals_lean_as_they_say() -> None:
    """A facet leaning towards +x by 10° is brightest under light from +x."""
    x = paper()
    x[:, 5], x[:, 7] = math.sin(math.radians(10)), math.cos(math.radians(10))
    rendering = linear("directional")
    right, left = (rendering(x, view=angle(0), light=angle(40), light_azimuth=angle(a))[0, 0, 4, 4] for a in (0, 180))
    assert right.item() == pytest.approx(math.cos(math.radians(30)), rel=1e-4)
    assert left.item() == pytest.approx(math.cos(math.radians(50)), rel=1e-4)


def test_an_environment_shines_from_where_it_is_drawn() -> None:
    """Light from φ = 90° (a quarter of the columns) at 45°: a facet leaning towards +y sees more of it; turned, +x."""
    light = torch.zeros(1, 3, 16, 32)
    light[:, :, 3:5, 7:9] = 50
    rendering = linear(light)
    lean = {}
    for name, k in (("x", 5), ("y", 6)):
        x = paper()
        x[:, k], x[:, 7] = 0.5, math.sqrt(0.75)
        for turn in (0.0, -90.0):
            lean[name, turn] = rendering(x, view=angle(0), light=angle(turn), probe=torch.zeros(1))[0, 0, 4, 4].item()
    assert lean["y", 0.0] > 1.5 * lean["x", 0.0]
    assert lean["x", -90.0] > 1.5 * lean["y", -90.0]
    assert lean["x", -90.0] == pytest.approx(lean["y", 0.0], rel=0.1)


def test_a_photograph_of_paper_is_exposed() -> None:
    """A uniform light of any strength makes grey paper its own grey, to the power 1/2.2."""
    for strength in (0.01, 30.0):
        rendering = Rendering(torch.full((1, 3, 8, 16), strength), sampling=Sampling(64))
        seen = rendering(paper(8, 0.5), view=angle(0))
        assert seen.mean().item() == pytest.approx(0.5 ** (1 / 2.2), abs=0.01)


def test_a_camera_that_sees_only_the_surface_is_exposed_to_the_light_on_it() -> None:
    """Grey paper is its own grey wherever a lamp stands; under light from all sides both exposures are the same."""
    lamps = torch.zeros(3, 3, 16, 32)
    lamps[0, :, 1], lamps[1, :, 5:7, 3], lamps[2] = 4.0, 90.0, 0.3
    metered, exposed = (Rendering(lamps, sampling=Sampling(512), metered=m) for m in ("surface", None))
    for probe, tolerance in ((0.0, 0.02), (1.0, 0.02), (2.0, 0.005)):
        latents = {"view": angle(0), "light": angle(0), "probe": torch.tensor([probe]), "jitter": torch.tensor([0.5])}
        seen = metered(paper(8, 0.3), **latents).mean().item()
        assert seen == pytest.approx(0.3 ** (1 / 2.2), abs=tolerance)
        alike = abs(seen - exposed(paper(8, 0.3), **latents).mean().item()) < 0.005
        assert alike == (probe == 2)


def test_stored_recipes_know_nothing_of_metering() -> None:
    assert "metered" not in describe(Rendering()) and describe(Rendering(metered="surface"))["metered"] == "surface"


def test_the_response_is_a_power_with_a_finite_slope() -> None:
    x = torch.tensor([0.0, 5e-5, 1e-4, 0.2, 1.0, 3.0], dtype=torch.float64, requires_grad=True)
    y = develop(x)
    expected = [0, 0.5 * 1e-4 ** (1 / 2.2), 1e-4 ** (1 / 2.2), 0.2 ** (1 / 2.2), 1, 1]
    torch.testing.assert_close(y.detach(), torch.tensor(expected, dtype=torch.float64))
    (slope,) = torch.autograd.grad(y.sum(), x)
    assert slope.isfinite().all() and slope[0] > 0 and slope[-1] == 0


def test_the_perspective_picture_from_above_is_the_texture() -> None:
    x = torch.rand(1, 8, 16, 16, generator=generator_at(0)) * 0.5 + 0.2
    x[:, 5:7], x[:, 7] = 0, 1
    flat, picture = (
        linear("directional", space=space)(x, view=angle(0), light=angle(20)) for space in ("texture", "image")
    )
    torch.testing.assert_close(picture, flat, rtol=1e-4, atol=1e-5)


def test_the_perspective_picture_is_foreshortened() -> None:
    """At 60° the plane is half as high, the far edge is narrower than the near one, and beside it is nothing."""
    picture = linear("directional", space="image")(paper(64), view=angle(60), light=angle(0))[0, 0]
    lit = picture > 0.5
    rows = lit.any(1).nonzero()
    assert int(rows.max() - rows.min()) + 1 == pytest.approx(32, abs=2)
    far, near = lit[int(rows.min()) + 1].sum(), lit[int(rows.max()) - 1].sum()
    assert far < near
    everywhere = linear("directional", space="image", repeat=True)(paper(64), view=angle(60), light=angle(0))[0, 0]
    assert everywhere.min() > 0.95


@pytest.mark.parametrize("lighting", ["coloured", None])
def test_a_plane_of_tiles_is_lit_as_one(lighting: str | None) -> None:
    """Nothing tells where a tile ends if the material is the same everywhere, and the middle is the material alone."""
    lamp = torch.full((1, 3, 16, 32), 0.1)
    lamp[:, :, 3:6, 6:12] = 4
    theta = {"view": angle(50)} | ({"light": angle(40), "light_azimuth": angle(90)} if lighting else {})
    rendering = linear(lighting or lamp, space="image", distance=2.0)
    x = mirror(0.4, 48)
    one, tiled = (replace(rendering, repeat=on)(x, **theta) for on in (False, True))
    smooth = F.avg_pool2d(tiled, 4)
    steps = smooth.diff(dim=3).abs().amax((0, 1, 2))
    assert steps.max() < 3 * steps.median() + 0.02 * smooth.max()
    covered = F.avg_pool2d(one, 4)
    middle = (..., slice(4, 8), slice(4, 8))
    torch.testing.assert_close(smooth[middle], covered[middle], rtol=0.06, atol=0.02)


def test_each_photograph_is_taken_alone() -> None:
    """A grazing view beside a view from above changes neither, nor do bands of rows."""
    rendering, x = linear("directional", space="image"), torch.rand(1, 8, 40, 40, generator=generator_at(4)) * 0.5 + 0.2
    both = rendering(x.repeat(2, 1, 1, 1), view=torch.tensor([0.0, 1.4]), light=torch.zeros(2))
    for k, view in enumerate((0.0, 1.4)):
        alone = rendering(x, view=torch.tensor([view]), light=torch.zeros(1))
        torch.testing.assert_close(both[k : k + 1], alone)


def test_turns_without_number_are_turns() -> None:
    rendering, x = Rendering(torch.rand(1, 3, 15, 30) + 0.1, sampling=Sampling(8)), paper(4)
    pictures = [
        rendering(x, view=angle(10), light=torch.tensor([t], dtype=torch.float64)) for t in (0.5, 0.5 + 2000 * math.pi)
    ]
    torch.testing.assert_close(*pictures, atol=1e-4, rtol=0)


def test_the_same_jitter_is_the_same_picture() -> None:
    rendering, light = Rendering(torch.rand(1, 3, 8, 16) + 0.1, sampling=Sampling(8)), angle(10)
    x = torch.rand(1, 8, 4, 4) * 0.5 + 0.2
    pictures = [rendering(x, view=angle(20), light=light, jitter=torch.tensor([j])) for j in (0.3, 0.3, 0.7)]
    assert torch.equal(pictures[0], pictures[1])
    assert not torch.equal(pictures[0], pictures[2])


def test_an_observation_draws_what_its_light_takes() -> None:
    lit = Rendering(torch.rand(3, 3, 8, 16) + 0.1)
    top, grazing = (Observation("view", lit, rendering_prior(lit, math.radians(angle))) for angle in (0, 80))
    rng = generator_at(1)
    for observation, low, high in ((top, -5, 5), (grazing, 75, 85)):
        drawn = observation.prior.sample(500, rng)
        view = drawn["view"] * 180 / math.pi
        assert view.min() >= low and view.max() <= high and view.max() - view.min() > 9
        assert drawn["probe"].long().unique().tolist() == [0, 1, 2]
        assert observation(torch.rand(2, 8, 4, 4) * 0.5 + 0.2, rng).shape == (2, 3, 4, 4)
    straight = rendering_prior(Rendering("directional"), 0.0, 0.0).sample(10, rng)
    assert straight["light"].abs().max() == 0
    anywhere = rendering_prior(Rendering("directional"), 0.0).sample(4000, rng)["light"]
    assert anywhere.cos().mean().item() == pytest.approx((1 + math.cos(math.radians(80))) / 2, abs=0.02)
    for lighting in ("directional", "coloured"):
        drawn = rendering_prior(Rendering(lighting), 0.0, 1.0, 0.1, light_azimuth=2.0).sample(500, rng)
        for name, middle in (("light", 1.0), ("light_azimuth", 2.0)):
            off = drawn[name] - middle
            assert -0.1 <= off.min() < -0.09 and 0.09 < off.max() <= 0.1


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Rendering("moon"), "ambient"),
        (lambda: Rendering(torch.ones(3, 8, 16)), "K, 3, H, W"),
        (lambda: Rendering(distance=0.1), "distance"),
        (lambda: Rendering(space="flat"), "space"),  # pyright: ignore[reportArgumentType]
        (lambda: Rendering()(paper(), view=torch.zeros(2)), "one view a material"),
        (lambda: Rendering()(paper().repeat(2, 1, 1, 1), view=torch.zeros(2), jitter=torch.zeros(1)), "one jitter"),
        (lambda: Rendering()(paper(), view=0.5), "one view a material"),  # pyright: ignore[reportArgumentType]
        (lambda: Rendering(torch.ones(1, 3, 8, 16, dtype=torch.uint8)), "float tensor"),
        (lambda: Rendering()(paper().byte(), view=torch.zeros(1)), "float tensors"),
        (lambda: Rendering()(torch.ones(1, 3, 4, 4), view=torch.zeros(1)), "maps"),
        (lambda: Rendering()(paper(), view=torch.zeros(1), light=torch.zeros(1)), "no light"),
        (lambda: rendering_prior(Rendering(), 0.0, 0.5), "leave it out"),
        (lambda: rendering_prior(Rendering(torch.ones(1, 3, 8, 16)), 0.0, 0.5), "leave it out"),
        (lambda: rendering_prior(Rendering("coloured"), 0.0, light_azimuth=1.0), "give light"),
        (lambda: up.Selection("colour"), "diffuse"),
        (lambda: up.Selection("diffuse")(torch.ones(1, 3, 4, 4)), "maps"),
    ],
)
def test_what_cannot_be_is_refused(make, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UserError, match=words):
        make()


def bad(name: str, change) -> dict[str, Tensor]:  # type: ignore[no-untyped-def]
    named = {key: value.clone() for key, value in unpack_maps(paper()).items()}
    named[name] = change(named[name])
    return named


@pytest.mark.parametrize(
    "maps, words",
    [
        (bad("normal", lambda n: n * 0), "unit length"),
        (bad("normal", lambda n: n * 1.2), "unit length"),
        (bad("normal", lambda n: -n), "into the surface"),
        (bad("diffuse", lambda d: d * math.nan), "NaN"),
        (bad("diffuse", lambda d: d - 2), "negative"),
        (bad("specular", lambda s: s - 1), "negative"),
        (bad("roughness", lambda m: m * 0), "positive"),
        (bad("diffuse", lambda d: d[:, :1]), r"give \(N, 3, H, W\)"),
        (bad("specular", lambda s: s[..., 1:]), "one number and size"),
        (
            bad("specular", lambda s: s.expand(-1, 2, -1, -1)),
            r"give \(N, 1, H, W\), or \(N, 3, H, W\) if it is coloured",
        ),
        ({"diffuse": torch.ones(1, 3, 4, 4)}, "missing"),
    ],
)
def test_bad_maps_are_named(maps: dict[str, Tensor], words: str) -> None:
    with pytest.raises(UserError, match=words) as caught:
        check_maps(pack_maps(maps))
    assert "\n" not in str(caught.value)
