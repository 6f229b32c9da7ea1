"""Cropped: pictures of objects of one height, and projections that are such pictures."""

from __future__ import annotations

import math

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.data import birds, chairs
from unproject.ops import bounding_box, framed, rotate_y
from unproject.ops.resampling import centres
from unproject.projections.cropped import Cropped
from unproject.projections.observation import Observation
from unproject.projections.priors import Product, Uniform
from unproject.projections.silhouette import Silhouette, Window
from unproject.projections.view import View
from unproject.testing import apply_laws
from unproject.testing.projections import PROJECTION_LAWS, projection_case

SIDE = 32
LEVEL = Product(Uniform("azimuth", 0, 6.28), Uniform("elevation", 0, 0))
ANYWHERE = Product(Uniform("azimuth", 0, 6.28), Uniform("elevation", -1.5, 1.5))
PHOTOGRAPHER = Product(ANYWHERE, Uniform("perspective", 0.05, 0.45), Uniform("roll", -1, 1))


def ball(radius: float, *centre: float) -> Tensor:
    axes = torch.meshgrid(*[centres(SIDE, torch.zeros(()))] * 3, indexing="ij")
    distance = torch.stack([axis - c for axis, c in zip(axes, centre, strict=True)]).norm(dim=0)
    return ((radius - distance) * SIDE / 2 + 0.5).clamp(0, 1)


def level(azimuth: Tensor) -> View:
    return View(azimuth, *[torch.zeros_like(azimuth)] * 3)


PLACES = [(0.02, 0.03, 0.02), (0.3, 0.2, 0.1), (-0.25, 0.1, 0.3), (0.1, -0.3, -0.35)]
ON_THE_GROUND = [(x, 0.0, z) for x, _, z in PLACES]


@pytest.mark.parametrize(
    "camera", [{}, {"perspective": 0.3}, {"roll": 0.7}, {"perspective": 0.2, "roll": -1.0}], ids=str
)
@pytest.mark.parametrize("elevation", [0.0, 0.5, -1.0])
def test_place_does_not_matter(elevation: float, camera: dict[str, float]) -> None:
    """A ball of the height that pictures are framed to gives the same disc from everywhere, wherever it is.

    Only level orthographic cameras see how high it is.
    """
    look = Cropped(Silhouette(size=SIDE, rule="absorption", density=4.0), height=0.5)
    volumes = torch.stack([ball(0.5, *place) for place in (PLACES if elevation or camera else ON_THE_GROUND)])
    theta = {name: torch.full((4,), value) for name, value in (camera | {"elevation": elevation}).items()}
    y = look(volumes, azimuth=torch.tensor([0.0, 0.7, 2.0, 4.0]), **theta)
    assert (y - y[:1]).abs().flatten(1).mean(1).max() < 0.03
    assert y.mean((1, 2, 3)).tolist() == pytest.approx([math.pi / 16] * 4, abs=0.05)  # rims absorb


@pytest.mark.parametrize("elevation", [0.0, 0.6])
def test_what_is_done_to_the_pictures_is_done_to_the_projections(elevation: float) -> None:
    """Pictures of any scale and place of an object of the common height, prepared, are the object's projections."""
    x, azimuth = birds(8, SIDE, seed=3), torch.arange(8) * 0.7
    tilt = torch.full((8,), elevation)
    tall = bounding_box(Silhouette()(x, azimuth=azimuth)).height / SIDE
    silhouette = Silhouette(size=SIDE, rule="absorption", density=4.0)
    for k in range(8):
        look = Cropped(silhouette, height=float(tall[k]))
        far = Silhouette(size=2 * SIDE, rule="absorption", density=4.0, viewport=1.4)
        photograph = far(x[k : k + 1], azimuth=azimuth[k : k + 1], elevation=tilt[k : k + 1]).roll((7, -5), (2, 3))
        y = look(x[k : k + 1], azimuth=azimuth[k : k + 1], elevation=tilt[k : k + 1])
        assert (look.prepare(photograph) - y).abs().mean() < 0.06


def test_an_object_of_another_height_keeps_its_height() -> None:
    """So that the discriminator settles the size."""
    look = Cropped(Silhouette(size=SIDE), height=0.5)
    for radius in (0.3, 0.6):
        y = look(ball(radius, 0.1, 0.2, 0.0)[None], azimuth=torch.tensor([0.3]), elevation=torch.zeros(1))
        assert bounding_box(y).height.item() / SIDE == pytest.approx(radius, abs=0.04)


@pytest.mark.parametrize("rule", ["any", "alpha", "absorption"])
def test_a_window_sees_a_part_of_the_picture(rule: str) -> None:
    """The pixels of a window that lie on those of the whole picture have the same values."""
    x, azimuth = birds(3, SIDE, seed=1), torch.tensor([0.0, 1.0, 4.0])
    window = Window(torch.full((3,), 0.5), torch.tensor([0.0, 3.0, -8.0]) / 16, torch.tensor([8.0, -2.0, 0.0]) / 16)
    part = Silhouette(size=16, rule=rule).seen(x, level(azimuth), window)  # type: ignore[arg-type]
    whole = Silhouette(size=32, rule=rule)(x, azimuth=azimuth)  # type: ignore[arg-type]
    for k, (row, column) in enumerate([(0, 8), (10, 11), (8, 0)]):
        torch.testing.assert_close(part[k], whole[k, :, row : row + 16, column : column + 16], atol=1e-5, rtol=0)


@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_gradients_through_a_window(rule: str) -> None:
    silhouette = Silhouette(size=6, rule=rule)  # type: ignore[arg-type]
    x = torch.rand(3, 5, 5, 5, dtype=torch.float64, generator=generator_at(0)).requires_grad_()
    places = ([0.5, 0.8, 1.2], [0.1, -0.2, 0.0], [0.05, 0.1, -0.3])
    window = Window(*(torch.tensor(place, dtype=torch.float64) for place in places))
    assert torch.autograd.gradcheck(
        lambda v: silhouette.seen(v, level(torch.tensor([0.3, 2.0, 4.0]).double()), window), (x,)
    )


def test_the_middle_is_that_of_the_view() -> None:
    x = torch.cat([ball(0.2, 0.5, 0.0, 0.0)[None], ball(0.2, 0.0, 0.0, 0.5)[None]])
    look = Cropped(Silhouette(size=SIDE), height=0.3)
    y = look(x, azimuth=torch.tensor([0.0, math.pi / 2]), elevation=torch.zeros(2))
    row, column = bounding_box(y).centre
    assert column.tolist() == pytest.approx([SIDE / 2] * 2, abs=0.2) and row.tolist() == pytest.approx([SIDE / 2] * 2)
    assert torch.allclose(y[0], y[1], atol=0.02)
    assert rotate_y(x, torch.zeros(2)).shape == x.shape


def test_pictures_of_wide_objects_are_cut_and_as_high_as_others() -> None:
    wide = torch.zeros(1, 1, SIDE, SIDE)
    wide[..., SIDE // 2 - 2 : SIDE // 2 + 2, 1:-1] = 1
    y = Cropped(Silhouette(size=SIDE), height=0.5).prepare(wide)
    assert bounding_box(y).height.item() == pytest.approx(SIDE / 2) and bounding_box(y).width.item() == SIDE


def test_pictures_are_prepared_so_that_thin_parts_are_inside() -> None:
    comb = torch.zeros(1, 1, 4 * SIDE, 4 * SIDE)
    comb[..., SIDE : 2 * SIDE, SIDE : 3 * SIDE] = 1
    comb[..., 2 * SIDE : 3 * SIDE, SIDE + 3 : 3 * SIDE : 12] = 1
    plain, whole = (Cropped(Silhouette(size=SIDE), height=0.5, level=level).prepare(comb) for level in (0.5, 0.25))
    legs = slice(SIDE // 2 + 2, SIDE * 3 // 4 - 2)
    assert plain[..., legs, :].max() < 0.5 <= whole[..., legs, :].amax(-1).min()
    assert torch.equal(whole > 0, plain > 0) and torch.equal(whole == 1, plain == 1)
    with pytest.raises(UserError, match="level between 0 and 1"):
        Cropped(Silhouette(size=SIDE), level=1.0)


def chair(count: int) -> Tensor:
    """Objects that fill most of the frame, so that in perspective their near parts would lie outside."""
    return chairs(count, SIDE).float()


@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_in_perspective_it_is_the_large_picture_framed(rule: str) -> None:
    """As high as the level view and in the middle, and as if it had been cut out of a picture that shows all of it."""
    x = chair(6)
    theta = {"azimuth": torch.arange(6.0), "elevation": torch.full((6,), 0.3), "perspective": torch.full((6,), 0.35)}
    theta |= {"roll": torch.linspace(-0.3, 0.3, 6)}
    y = Cropped(Silhouette(size=SIDE, rule=rule, density=4.0))(x, **theta)  # type: ignore[arg-type]
    level = bounding_box(Silhouette(rule=rule, density=4.0)(x, azimuth=theta["azimuth"])).height  # type: ignore[arg-type]
    box, middle = bounding_box(y), SIDE / 2
    assert (box.height - level).abs().max() < 0.7
    assert max((place - middle).abs().max() for place in box.centre) < 0.5
    large = Silhouette(size=4 * SIDE, rule=rule, density=4.0, viewport=2.0)(x, **theta)  # type: ignore[arg-type]
    for k in range(6):
        assert (framed(large[k : k + 1], SIDE, float(level[k]) / SIDE, 1.0) - y[k]).abs().mean() < 0.03


@pytest.mark.parametrize("camera", [{}, {"perspective": 0.2}], ids=["orthographic", "perspective"])
def test_haze_that_a_level_camera_sees_edge_on_has_no_say_in_the_scale(camera: dict[str, float]) -> None:
    x, look = chair(3), Cropped(Silhouette(size=SIDE, rule="absorption", density=2.0))
    hazy = x.clone()
    hazy[:, :, 0] = hazy[:, :, 0].clamp_min(0.08)
    theta = {name: torch.full((3,), value) for name, value in ({"elevation": 1.2} | camera).items()}
    clear, hidden = (look(volume, azimuth=torch.arange(3.0), **theta) for volume in (x, hazy))
    assert (bounding_box(clear).height - bounding_box(hidden).height).abs().max() < 0.5


TILTED, ROLLED = {"elevation": 0.2}, {"elevation": 0.2, "perspective": 0.22, "roll": 0.1}


@pytest.mark.parametrize(
    "name, camera", [("elevation", TILTED), ("elevation", ROLLED), ("perspective", ROLLED), ("roll", ROLLED)]
)
def test_gradients_by_latents_know_of_the_frame(name: str, camera: dict[str, float]) -> None:
    """A frame that is taken for constant would give gradients of the wrong sign."""
    count = 16
    x, look = chair(count).double(), Cropped(Silhouette(size=SIDE, rule="absorption", density=2.0))
    theta = {key: torch.full((count,), value).double() for key, value in camera.items()}
    weight = F.interpolate(torch.rand(count, 1, 4, 4, generator=generator_at(0)).double(), size=SIDE, mode="bilinear")

    def loss(at: Tensor) -> Tensor:
        return (look(x, azimuth=0.3 + torch.arange(count), **theta | {name: at}) * weight).sum((1, 2, 3))

    (slope,) = torch.autograd.grad(loss(leaf := theta[name].clone().requires_grad_()).sum(), leaf)
    rise = (loss(theta[name] + 0.005) - loss(theta[name] - 0.005)) / 0.01
    assert F.cosine_similarity(slope, rise, 0) > 0.9 and 0.8 < slope.norm() / rise.norm() < 1.25


@pytest.mark.parametrize("prior", [LEVEL, ANYWHERE, PHOTOGRAPHER], ids=["level", "anywhere", "photographer"])
@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_all_laws_hold_but_that_of_the_gradient(rule: str, prior: Product) -> None:
    """Where the object is in the picture is a constant for gradients in x, and in a level view in the azimuth."""
    look = Cropped(Silhouette(size=6, rule=rule), 0.5)  # type: ignore[arg-type]
    few = torch.rand(2, 5, 5, 5, generator=generator_at(0)) ** 3  # where gradcheck fails it is slow
    results = apply_laws(PROJECTION_LAWS, projection_case(Observation("cropped", look, prior), few, 0))
    assert {result.name for result in results if not result.passed} <= {"differentiable"} | (
        {"latents"} if prior is LEVEL else set()
    )


def test_a_fixed_pinhole_is_refused() -> None:
    with pytest.raises(UserError, match="this pinhole is fixed"):
        Cropped(Silhouette(size=8, camera="perspective"))


@pytest.mark.parametrize("wrong", [{"height": 0.0}, {"height": 1.1}, {"silhouette": Silhouette()}], ids=str)
def test_frames_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(UserError, match="give the silhouette a size"):
        Cropped(**{"silhouette": Silhouette(size=8), **wrong})  # type: ignore[arg-type]
