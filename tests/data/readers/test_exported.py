"""What `unproject export` wrote is read as what it was."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

import unproject as up
from unproject import export
from unproject._types import UserError
from unproject.ops.maps import pack_maps, unpack_maps, with_specular

TOLERANCE = {"8": 0.02, "16": 1e-3, "half": 2e-3, "float": 1e-5}


def materials(kind: str) -> torch.Tensor:
    maps = up.data.metal(2, 16, seed=1, coloured=kind == "coloured")
    if kind == "bright":
        specular = unpack_maps(maps)["specular"]
        maps = pack_maps({**unpack_maps(maps), "specular": 2.5 * specular / specular.amax((1, 2, 3), keepdim=True)})
    return maps


@pytest.mark.parametrize("depth", TOLERANCE)
@pytest.mark.parametrize("kind", ["one channel", "coloured", "bright"])
def test_exported_maps_come_back(depth: Any, kind: str, tmp_path: Path) -> None:
    maps = materials(kind)
    export.material_maps(maps, tmp_path / "out", depth=depth, fresnel="albedo")
    found = up.data.read_material(
        tmp_path / "out" / "material-01", specular="colour" if kind == "coloured" else "luminance"
    )
    assert (found - maps[1]).abs().max() <= TOLERANCE[depth] * max(1.0, maps.abs().max().item())


def test_a_coloured_one_is_read_as_its_luminance_unless_asked(tmp_path: Path) -> None:
    maps = materials("coloured")[:1]
    export.material_maps(maps, tmp_path, depth="float", fresnel="albedo")
    assert (up.data.read_material(tmp_path) - with_specular(maps, 1)[0]).abs().max() < 1e-5


def test_reflectances_for_an_index_are_those_of_the_surface(tmp_path: Path) -> None:
    export.material_maps(materials("one channel")[:1], tmp_path, depth="float", fresnel="eta", eta=1.5)
    found = unpack_maps(up.data.read_material(tmp_path)[None])["specular"]
    assert torch.allclose(found, 0.04 * unpack_maps(materials("one channel")[:1])["specular"], atol=1e-6)


def spoiled(folder: Path, **changes: Any) -> None:
    note = json.loads((folder / "material.json").read_text())
    note["maps"]["specular"] |= changes
    (folder / "material.json").write_text(json.dumps(note))


@pytest.mark.parametrize(
    "changes",
    [
        {"file": "../specular.png"},
        {"file": ".."},
        {"file": ""},
        {"file": 3},
        {"encoding": "gamma"},
        {"scale": "nan"},
        {"scale": 0},
        {"scale": None},
    ],
)
def test_damaged_notes_are_one_line(changes: dict[str, Any], tmp_path: Path) -> None:
    folder = tmp_path / "wood"
    up.export.material_maps(materials("one channel")[:1], folder)
    (tmp_path / "specular.png").write_bytes((folder / "specular.png").read_bytes())
    spoiled(folder, **changes)
    with pytest.raises(UserError, match="export the material again") as error:
        up.data.read_material(folder)
    assert "\n" not in str(error.value)


def test_pictures_of_other_sizes_or_channels_are_refused(tmp_path: Path) -> None:
    for name, maps in (("small", up.data.wood(1, 16, seed=1)), ("large", up.data.wood(1, 24, seed=1))):
        export.material_maps(maps, tmp_path / name)
    for file, why in (("roughness.png", "differ in size"), ("normal.png", "is coloured where a grey picture is meant")):
        (tmp_path / "small" / "roughness.png").write_bytes((tmp_path / "large" / file).read_bytes())
        with pytest.raises(UserError, match=why):
            up.data.read_material(tmp_path / "small")


def test_pictures_that_another_program_saved_again_are_the_same(tmp_path: Path) -> None:
    """With alpha, or a grey one in colours."""
    up.export.material_maps(materials("one channel")[:1], tmp_path)
    before = up.data.read_material(tmp_path)
    for name, mode in (("basecolor", "RGBA"), ("roughness", "RGB"), ("specular", "LA")):
        with Image.open(tmp_path / f"{name}.png") as picture:
            picture.convert(mode).save(tmp_path / f"{name}.png")
    assert torch.allclose(up.data.read_material(tmp_path), before, atol=1e-6)


def test_the_steepest_normals_come_back_from_half_floats(tmp_path: Path) -> None:
    x = materials("one channel")[:1]
    x[:, -3:] = torch.tensor([(1 - 1e-4**2) ** 0.5, 0, 1e-4]).view(1, 3, 1, 1)
    export.material_maps(x, tmp_path, depth="half")
    assert (up.data.read_material(tmp_path)[-1] - 1e-4).abs().max() < 2e-3


def test_the_note_of_another_program_says_nothing(tmp_path: Path) -> None:
    up.export.material_maps(materials("one channel")[:1], tmp_path)
    ours = up.data.read_material(tmp_path)
    (tmp_path / "material.json").write_text('{"shader": "principled", "from": "unproject material"}')
    theirs = up.data.read_material(tmp_path)
    ratio = theirs[3].mean() / ours[3].mean()
    assert ratio == pytest.approx(0.08, rel=0.02)
