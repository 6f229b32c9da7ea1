"""Materials in the studio: the plane as `up.Rendering` photographs it, the ball as analysis says; light is guarded."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from unproject.assignment import Panel
from unproject.data import Collection, metal, wood
from unproject.networks import Discriminator
from unproject.networks.materials import StationaryMaterials
from unproject.ops.environment import solid_angles
from unproject.ops.maps import with_specular
from unproject.ops.microfacet import Reflection
from unproject.ops.shading import Sampling
from unproject.projections import Identity, Rendering
from unproject.projections.observation import Observation
from unproject.studio import materials
from unproject.studio.answers import Request
from unproject.studio.lighting import PAPER, SIDE, Scene, exposed, picture_of_scene
from unproject.studio.server import respond
from unproject.studio.state import State
from unproject.training import Recipe, train

Said = Callable[..., tuple[int, dict[str, Any]]]
ALBEDO = Reflection("albedo")


def white(normal: tuple[float, float, float] = (0, 0, 1)) -> torch.Tensor:
    """A white matt material (8, 8, 8) whose normals point that way."""
    n = torch.nn.functional.normalize(torch.tensor(normal, dtype=torch.float32), dim=0)
    return torch.cat([torch.ones(3), torch.zeros(1), torch.full((1,), 0.3), n]).view(8, 1, 1).expand(8, 8, 8)


def scene(form: Any = "ball", light: Any = "directional", view: float = 1.0, polar: float = 0.0) -> Scene:
    return Scene(form, view, -math.pi / 2, light, polar, 0.0, 64)


def test_the_tile_is_what_a_rendering_photographs() -> None:
    maps = torch.as_tensor(wood(1, SIDE, 0)).float()
    angles = {"view": 0.9, "view_azimuth": -math.pi / 2, "light": 0.6, "light_azimuth": 0.3}
    theta = {name: torch.tensor([value]) for name, value in angles.items()}
    wanted = Rendering("directional", ALBEDO, Sampling(64), space="image")(maps, **theta)[0]
    found = picture_of_scene(maps[0], Scene("tile", 0.9, -math.pi / 2, "directional", 0.6, 0.3, 64), ALBEDO)
    inside = wanted.sum(0) > 0.1
    assert inside.float().mean() > 0.3
    assert (found - wanted).abs()[:, inside].mean() < 0.01


@pytest.mark.parametrize("light", ["ambient", "directional", "coloured"])
@pytest.mark.parametrize("form", ["tile", "plane", "ball"])
def test_three_equal_specular_channels_are_lit_as_one(form: str, light: str) -> None:
    maps = metal(1, 32, 3)
    one, three = (picture_of_scene(x[0], scene(form, light), ALBEDO) for x in (maps, with_specular(maps, 3)))
    torch.testing.assert_close(three, one)
    gold = metal(1, 32, 3, coloured=True)
    gold[:, 3:6] *= torch.tensor([1.0, 0.5, 0.1])[:, None, None]
    assert (picture_of_scene(gold[0], scene(form, light), ALBEDO) - one).abs().amax() > 0.05


def test_a_white_ball_follows_the_cosine_of_the_light() -> None:
    found = picture_of_scene(white(), scene(view=0.0), ALBEDO)
    across = (2 * torch.arange(SIDE) + 1 - SIDE) / (SIDE - 8)
    cosine = (1 - across.square() - across[SIDE // 2] ** 2).clamp(min=0).sqrt()
    inside = cosine > 0.3
    assert torch.allclose(found[0, SIDE // 2, inside], cosine[inside] ** (1 / 2.2), atol=0.01)


def test_a_white_ball_in_white_light_is_white_and_lies_on_paper() -> None:
    found = picture_of_scene(white(), scene(light="ambient"), ALBEDO)
    assert torch.allclose(found[:, SIDE // 2, SIDE // 2], torch.ones(3), atol=0.02)
    assert torch.allclose(found[:, 0, 0], torch.full((3,), PAPER), atol=1e-5)


def test_a_normal_to_the_right_faces_a_light_from_the_right() -> None:
    tilted, mirrored = (
        picture_of_scene(white((x, 0, 1)), scene(view=1.5, polar=1.5), ALBEDO)[0, SIDE // 2, SIDE // 2]
        for x in (0.5, -0.5)
    )
    assert tilted > mirrored + 0.1


def test_an_environment_of_one_radiance_is_as_ambient_light() -> None:
    lit = exposed(torch.ones(3, 16, 32))
    found, wanted = (picture_of_scene(white(), scene(light=light), ALBEDO) for light in (lit, "ambient"))
    assert (found - wanted).abs().mean() < 0.02


@pytest.fixture(scope="module")
def woods(tmp_path_factory: pytest.TempPathFactory) -> State:
    folder = tmp_path_factory.mktemp("woods")
    recipe = Recipe(
        partial(StationaryMaterials, size=16, channels=8),
        [Panel([Observation("itself", Identity())], Collection(torch.as_tensor(wood(4, 16, 0)).float()))],
        discriminator=partial(Discriminator, channels=4),
        steps=2,
        batch=2,
    )
    train(recipe, folder / "wood", quiet=True)
    return State(folder)


def rendered(state: State, **query: Any) -> tuple[int, bytes]:
    given = {"run": "wood", **{name: str(value) for name, value in query.items()}}
    answer = respond(state, "GET", "/api/render", Request(given))
    return answer.status, answer.content


def test_a_run_of_materials_is_rendered_and_its_maps_are_shown(woods: State, said: Said) -> None:
    status, content = rendered(woods, form="plane", light="window", samples=4)
    assert status == 200
    with Image.open(io.BytesIO(content)) as picture:
        assert (picture.format, picture.size) == ("JPEG", (SIDE, SIDE))
    status, found = said(woods, "/api/maps", run="wood")
    assert list(found["maps"]) == ["diffuse", "specular", "roughness", "normal"]
    assert "window" in found["lights"]


WRONG = {
    "form": {"form": "cube"},
    "light": {"light": "../../etc/passwd"},
    "view": {"view": 89},
    "samples": {"samples": 100000},
    "turn": {"turn": "inf"},
}


@pytest.mark.parametrize("query", WRONG.values(), ids=list(WRONG))
def test_what_cannot_be_rendered_is_refused(woods: State, query: dict[str, object]) -> None:
    assert rendered(woods, **query)[0] in (400, 404)


@pytest.mark.parametrize("angle", ["around", "turn"])
def test_camera_and_light_may_turn_for_ever(woods: State, angle: str) -> None:
    pictures = [rendered(woods, light="directional", samples=4, **{angle: turn}) for turn in (-6, -3606)]
    assert pictures[0][0] == 200 and pictures[0] == pictures[1]


def test_a_run_of_shapes_has_no_materials(runs: Path, said: Said) -> None:
    status, found = said(State(runs), "/api/maps", run="toy")
    assert status == 400 and "makes no materials" in found["error"]


def test_a_dropped_light_lights(woods: State, said: Said) -> None:
    stored = io.BytesIO()
    np.save(stored, np.ones((8, 16, 3), np.float32))
    status, found = said(woods, "/api/light", "POST", stored.getvalue(), name="mine.npy")
    assert status == 200 and found["light"].startswith("dropped-")
    assert rendered(woods, light=found["light"], samples=4)[0] == 200


def test_a_fine_light_is_reduced_by_solid_angle(woods: State, said: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sun at the pole is as bright as it was."""
    given, taken, stored = torch.full((3, 64, 128), 0.1), [], io.BytesIO()
    given[:, 0] = 1000.0
    np.save(stored, given.movedim(0, 2).numpy())
    monkeypatch.setattr(materials, "FINEST", 16)
    monkeypatch.setattr(materials, "exposed", lambda radiance: taken.append(radiance) or exposed(radiance))
    assert said(woods, "/api/light", "POST", stored.getvalue(), name="sun.npy")[0] == 200
    assert taken[0].shape == (3, 16, 32)
    light = [(radiance * solid_angles(*radiance.shape[1:])).sum().item() for radiance in (given, taken[0])]
    assert light[1] == pytest.approx(light[0], rel=1e-5)


PICKLED = b"\x93NUMPY\x01\x00v\x00{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(128) + b"x"
BAD = {
    "not a picture": ("sky.hdr", b"no picture"),
    "a truncated one": ("sky.exr", b"v/1\x01\x02"),
    "code": ("sky.npy", PICKLED),
    "another kind": ("sky.zip", b"PK"),
    "a path": ("../../sky", b""),
}


@pytest.mark.parametrize("name, content", BAD.values(), ids=list(BAD))
def test_a_light_that_is_none_is_refused_by_name(woods: State, said: Said, name: str, content: bytes) -> None:
    status, found = said(woods, "/api/light", "POST", content, name=name)
    assert status == 400
    assert name in found["error"] and "/tmp" not in found["error"]
