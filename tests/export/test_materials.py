"""Material maps: what artists' tools read back is the material, by the word of readers that are not ours."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from unproject import export
from unproject._pictures import read_stored
from unproject._types import UserError
from unproject.export.material_x import lobe_for
from unproject.ops.microfacet import Reflection

GLTF = Path(__file__).parents[1] / "gltf"
NAMES = ("basecolor", "specular", "roughness", "normal")
UNIT = 0.04  # F0 where k_s is 1 and eta 1.5
HALF = 0.51 / 255  # half a step of eight bits, and what float32 adds


def a_material(seed=0, height=6, width=9, diffuse=1.0, specular=1.0, roughness=1.0):
    """(8, H, W) of random maps whose largest values are those given."""
    rng = np.random.default_rng(seed)
    n = rng.normal(size=(3, height, width))
    n[2] = np.abs(n[2]) + 0.2
    maps = np.concatenate([rng.random((5, height, width)), n / np.linalg.norm(n, axis=0)])
    maps[4] += 0.01
    for place, most in ((slice(0, 3), diffuse), (slice(3, 4), specular), (slice(4, 5), roughness)):
        maps[place] *= most / maps[place].max()
    return maps.astype(np.float32)


def coloured(maps, *tints):
    """The same with k_s of three channels, the one times each tint (default: 1, 0.7, 0.3)."""
    tint = np.array(tints or (1, 0.7, 0.3), np.float32)[:, None, None]
    return np.concatenate([maps[:3], maps[3:4] * tint, maps[4:]])


def expected(maps, f0=UNIT):
    """The four quantities as (H, W, C), by this test's own arithmetic."""
    x = np.moveaxis(maps.astype(np.float64), 0, -1)
    return {
        "basecolor": x[..., :3],
        "specular": f0 * x[..., 3:-4],
        "roughness": x[..., -4:-3] ** 0.5,
        "normal": x[..., -3:],
    }


def from_srgb(v):
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def to_srgb(v):
    return np.where(v <= 0.04045 / 12.92, v * 12.92, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)


def coded(maps, f0, scales, suffix):
    """What the pictures should hold."""
    want = {name: value / scales.get(name, 1) for name, value in expected(maps, f0).items()}
    want["normal"] = (want["normal"] + 1) / 2
    if suffix == "png":
        want["basecolor"] = to_srgb(want["basecolor"])
    return want


def note(folder):
    return json.loads((folder / "material.json").read_text(encoding="utf-8"))


def scales(folder):
    return {name: about["scale"] for name, about in note(folder)["maps"].items()}


def pillow(path):
    with Image.open(path) as image:
        assert image.mode in ("RGB", "L")
        return np.atleast_3d(np.asarray(image)) / 255


DEPTHS = {"8": ("png", 0.51 / 255), "16": ("png", 0.51 / 65535), "half": ("exr", 5e-4), "float": ("exr", 1e-6)}


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("tinted", [False, True])
@pytest.mark.parametrize("fresnel, eta, f0", [("eta", 1.5, UNIT), ("eta", 3.0, 0.25), ("albedo", 1.5, 1.0)])
def test_the_pictures_hold_the_material(tmp_path, depth, fresnel, eta, f0, tinted):
    suffix, tolerance = DEPTHS[depth]
    maps = coloured(a_material()) if tinted else a_material()
    written = export.material_maps(torch.from_numpy(maps), tmp_path / "wood", depth=depth, fresnel=fresnel, eta=eta)
    names = ["basecolor", "normal", "roughness", "specular"]
    assert [p.name for p in written.paths] == [*(f"{n}.{suffix}" for n in names), "material.json"]
    assert sorted(os.listdir(tmp_path / "wood")) == sorted(p.name for p in written.paths)
    about = note(tmp_path / "wood")
    assert (about["fresnel"], about["eta"]) == (fresnel, eta)
    assert about["F0_where_k_s_is_1"] == pytest.approx(f0)
    for name, want in coded(maps, f0, {}, suffix).items():
        pixels, stored = read_stored(tmp_path / "wood" / about["maps"][name]["file"])
        assert stored == about["maps"][name]["stored"] and about["maps"][name]["scale"] == 1
        assert pixels.shape == want.shape
        np.testing.assert_allclose(pixels, want, atol=tolerance, rtol=tolerance if suffix == "exr" else 0)
        encoded = suffix == "png" and name == "basecolor"
        assert about["maps"][name]["encoding"] == ("sRGB" if encoded else "linear")


def test_pillow_reads_the_same_and_row_0_is_the_top(tmp_path):
    maps = a_material()
    maps[:3, 0] = torch.tensor([1.0, 0.0, 0.0])[:, None]
    export.material_maps(maps, tmp_path, fresnel="eta")
    for name, want in coded(maps, UNIT, {}, "png").items():
        np.testing.assert_allclose(pillow(tmp_path / f"{name}.png"), want, atol=HALF)
    assert (pillow(tmp_path / "basecolor.png")[0] == [1, 0, 0]).all()


@pytest.mark.parametrize("depth", ["8", "16"])
def test_values_above_one_are_divided_by_a_stated_scale(tmp_path, depth):
    maps = a_material(diffuse=2.5, specular=40.0, roughness=2.25)
    export.material_maps(maps, tmp_path, depth=depth, fresnel="eta")
    stated = scales(tmp_path)
    assert stated == pytest.approx({"basecolor": 2.5, "specular": 1.6, "roughness": 1.5, "normal": 1})
    for name, want in coded(maps, UNIT, stated, "png").items():
        pixels = read_stored(tmp_path / f"{name}.png").pixels
        np.testing.assert_allclose(pixels, want, atol=DEPTHS[depth][1])
        assert name == "normal" or pixels.max() == 1


def test_exr_keeps_values_above_one_as_they_are(tmp_path):
    maps = a_material(diffuse=2.5, specular=40.0)
    export.material_maps(maps, tmp_path, depth="float", fresnel="eta")
    assert set(scales(tmp_path).values()) == {1}
    np.testing.assert_allclose(read_stored(tmp_path / "specular.exr").pixels.max(), 1.6, rtol=1e-6)


def test_half_floats_do_not_overflow(tmp_path):
    maps = a_material(diffuse=1e6)
    export.material_maps(maps, tmp_path, depth="half")
    pixels = scales(tmp_path)["basecolor"] * read_stored(tmp_path / "basecolor.exr").pixels
    np.testing.assert_allclose(pixels, expected(maps)["basecolor"], rtol=1e-3, atol=1)


def test_mitsuba_reads_sixteen_bits_and_exr_as_the_material(tmp_path):
    if importlib.util.find_spec("mitsuba") is None:
        pytest.skip("mitsuba is not installed")
    maps = a_material(diffuse=1.5)
    for depth in ("16", "half", "float"):
        export.material_maps(maps, tmp_path / depth, depth=depth, fresnel="albedo")
    code = (
        "import sys, numpy as np, mitsuba as mi; mi.set_variant('scalar_rgb');"
        "[np.save(f + '.npy', np.array(mi.Bitmap(f))) for f in sys.argv[1:]]"
    )
    files = [tmp_path / d / f"{name}.{DEPTHS[d][0]}" for d in ("16", "half", "float") for name in NAMES]
    subprocess.run([sys.executable, "-c", code, *files], check=True, capture_output=True)
    for file in files:
        suffix, tolerance = DEPTHS[file.parent.name]
        pixels = np.load(f"{file}.npy")
        assert pixels.dtype == {"16": np.uint16, "half": np.float16, "float": np.float32}[file.parent.name]
        pixels = np.atleast_3d(pixels) / (65535.0 if suffix == "png" else 1.0)
        want = coded(maps, 1.0, scales(file.parent), suffix)[file.stem]
        np.testing.assert_allclose(pixels, want, atol=tolerance, rtol=tolerance if suffix == "exr" else 0)


# MaterialX


def library_document(path):
    """The document as the MaterialX library reads it, validated against the standard definitions."""
    mx = pytest.importorskip("MaterialX")
    standard, document = mx.createDocument(), mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), standard)
    mx.readFromXmlFile(document, str(path))
    document.setDataLibrary(standard)
    valid, message = document.validate()
    return document, valid, message


def evaluated(node, name, folder):
    """The value of a node's input for every texel: constants, pictures and products, as the library resolves them."""
    source = node.getInput(name)
    if source.getValue() is not None and source.getConnectedOutput() is None and source.getConnectedNode() is None:
        value = source.getValue()
        return np.asarray(value if isinstance(value, float) else value.asTuple(), np.float64)
    output = source.getConnectedOutput()
    upstream = output.getConnectedNode() if output else source.getConnectedNode()
    operations = {"multiply": np.multiply, "divide": np.divide, "max": np.maximum}
    if upstream.getCategory() in operations:
        return operations[upstream.getCategory()](*(evaluated(upstream, part, folder) for part in ("in1", "in2")))
    if upstream.getCategory() == "extract":
        return evaluated(upstream, "in", folder)[..., upstream.getInput("index").getValue()][..., None]
    if upstream.getCategory() == "normalmap":
        return 2 * evaluated(upstream, "in", folder) - 1
    assert upstream.getCategory() == "image"
    file = upstream.getInput("file")
    pixels = read_stored(folder / file.getValueString()).pixels.astype(np.float64)
    return from_srgb(pixels) if file.getColorSpace() == "srgb_texture" else pixels


@pytest.mark.parametrize(
    "fresnel, specular", [("eta", 1.0), ("eta", 0.3), ("eta", 22.0), ("eta", 30.0), ("albedo", 0.8), ("albedo", 1.3)]
)
@pytest.mark.parametrize("depth", ["16", "float"])
def test_materialx_reads_back_the_material(tmp_path, fresnel, specular, depth):
    maps = a_material(diffuse=1.5, specular=specular, roughness=1.21)
    written = export.material_x(maps, tmp_path, depth=depth, fresnel=fresnel)
    assert "material.mtlx" in [p.name for p in written.paths]
    document, valid, message = library_document(tmp_path / "material.mtlx")
    assert valid, message
    (material,) = document.getMaterialNodes()
    surface = material.getInput("surfaceshader").getConnectedNode()
    assert surface.getCategory() == "standard_surface" and surface.getNodeDef() is not None
    got = {k: evaluated(surface, k, tmp_path) for k in ("base", "base_color", "specular_color", "specular_IOR")}
    got |= {k: evaluated(surface, k, tmp_path) for k in ("specular", "specular_roughness", "normal", "metalness")}
    want = expected(maps, UNIT if fresnel == "eta" else 1.0)
    assert got["base"] == 1 and got["metalness"] == 0 and got["specular"].max() <= 1 + 1e-5
    np.testing.assert_allclose(got["base_color"], want["basecolor"], atol=1e-4)
    np.testing.assert_allclose(got["specular_roughness"], want["roughness"], atol=2e-5)
    np.testing.assert_allclose(got["normal"], want["normal"], atol=2e-5)
    f0 = got["specular"] * got["specular_color"] * ((got["specular_IOR"] - 1) / (got["specular_IOR"] + 1)) ** 2
    np.testing.assert_allclose(f0, np.broadcast_to(want["specular"], f0.shape), atol=2e-5)


@pytest.mark.parametrize("tints", [(1, 0.7, 0.3), (0.2, 0.5, 1), (1, 1, 1), (0, 0, 0)])
@pytest.mark.parametrize("fresnel, specular", [("eta", 1.0), ("albedo", 0.8), ("albedo", 1.0)])
@pytest.mark.parametrize("depth", ["16", "float"])
def test_materialx_reads_back_a_coloured_reflectance(tmp_path, fresnel, specular, depth, tints):
    """As a weight, by which the base is dimmed, and a colour whose largest channel reflects all that the index does."""
    maps = coloured(a_material(specular=specular), *tints)
    export.material_x(maps, tmp_path, depth=depth, fresnel=fresnel)
    document, valid, message = library_document(tmp_path / "material.mtlx")
    assert valid, message
    surface = document.getMaterialNodes()[0].getInput("surfaceshader").getConnectedNode()
    weight, colour, index = (evaluated(surface, k, tmp_path) for k in ("specular", "specular_color", "specular_IOR"))
    unit = ((index - 1) / (index + 1)) ** 2
    want = expected(maps, UNIT if fresnel == "eta" else 1.0)["specular"]
    np.testing.assert_allclose(weight * colour * unit, want, atol=2e-5)
    assert weight.max() <= 1 + 1e-5 and weight.shape == (*want.shape[:2], 1)
    assert colour.max() <= max(1, want.max() / 0.9) * 1.02  # what no weight can say, and rounding
    if any(tints):
        lit = want.max(-1) > 1e-3
        largest = colour.max(-1)[lit]
        np.testing.assert_allclose(largest, largest.mean(), rtol=2e-2 if depth == "16" else 1e-4)


def test_the_index_is_eta_while_it_can_be(tmp_path):
    assert lobe_for(UNIT, "eta", 1.5) == (1.5, 1) and lobe_for(0.01, "eta", 1.5) == (1.5, 1)
    assert lobe_for(0.25, "albedo", 1.5).ior == pytest.approx(3) and lobe_for(0.25, "eta", 1.5).ior == pytest.approx(3)
    for largest in (0.0, 1e-9, 0.04, 0.89, 1.0, 3.0):
        lobe = lobe_for(largest, "albedo", 1.5)
        assert 1 < lobe.ior < 40 and lobe.color >= 1 and lobe.reflectance >= largest * (1 - 1e-12)


@pytest.mark.parametrize("depth, space", [("8", "srgb_texture"), ("half", "lin_rec709")])
def test_the_colour_space_is_the_files(tmp_path, depth, space):
    export.material_x(a_material(), tmp_path, depth=depth)
    document, *_ = library_document(tmp_path / "material.mtlx")
    files = {node.getName(): node.getInput("file") for node in document.getNodeGraph("maps").getNodes("image")}
    assert files["basecolor"].getColorSpace() == space
    assert all((tmp_path / file.getValueString()).is_file() for file in files.values())


@pytest.mark.parametrize("tinted", [False, True])
def test_materialx_makes_a_shader_of_it(tmp_path, tinted):
    pytest.importorskip("MaterialX")
    import MaterialX as mx  # noqa: N813
    from MaterialX.PyMaterialXGenGlsl import GlslShaderGenerator
    from MaterialX.PyMaterialXGenShader import GenContext

    maps = a_material(diffuse=1.5)
    export.material_x(coloured(maps) if tinted else maps, tmp_path)
    document, *_ = library_document(tmp_path / "material.mtlx")
    generator = GlslShaderGenerator.create()
    context = GenContext(generator)
    context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    context.getOptions().emitColorTransforms = False
    shader = generator.generate("ours", document.getMaterialNodes()[0], context)
    text = shader.getSourceCode("pixel")
    assert "mx_dielectric_bsdf" in text and "mx_normalmap" in text and text.count("mx_image_") >= 4


def test_the_library_does_find_faults(tmp_path):
    export.material_x(a_material(), tmp_path)
    text = (tmp_path / "material.mtlx").read_text()
    (tmp_path / "material.mtlx").write_text(
        text.replace('name="specular_IOR" type="float"', 'name="ior" type="color3"')
    )
    assert not library_document(tmp_path / "material.mtlx")[1]


# glTF


class Glb:
    """A .glb taken apart by hand."""

    def __init__(self, path):
        content = path.read_bytes()
        magic, version, length = struct.unpack("<4sII", content[:12])
        size, kind = struct.unpack("<I4s", content[12:20])
        assert (magic, version, length, kind) == (b"glTF", 2, len(content), b"JSON")
        self.tree = json.loads(content[20 : 20 + size])
        assert content[24 + size : 28 + size] == b"BIN\0"
        self.binary = content[28 + size :]

    def view(self, index):
        view = self.tree["bufferViews"][index]
        return self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def pixels(self, texture):
        source = self.tree["textures"][texture["index"]]["source"]
        with Image.open(io.BytesIO(self.view(self.tree["images"][source]["bufferView"]))) as image:
            assert image.format == "PNG" and image.mode in ("RGB", "RGBA")
            return np.asarray(image) / 255

    def attribute(self, primitive, name):
        accessor = self.tree["accessors"][primitive["attributes"][name]]
        return np.frombuffer(self.view(accessor["bufferView"]), "<f4").reshape(accessor["count"], -1)


def validated(path):
    node = shutil.which("node")
    if node is None or not (GLTF / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("the glTF validator needs node and `npm ci` in tests/gltf")
    report = subprocess.run([node, GLTF / "validate.mjs", path], capture_output=True, text=True, check=True)
    return json.loads(report.stdout)


def some(n, **most):
    return np.stack([a_material(seed, **most) for seed in range(n)])


BLACK = some(2) * np.array([1, 1, 1, 0, 1, 1, 1, 1], np.float32)[:, None, None]


@pytest.mark.parametrize(
    "maps",
    [some(1), some(5, diffuse=1.5, specular=40.0), BLACK, np.stack([coloured(x) for x in some(2)])],
    ids=["one", "brighter than 1", "no specular", "coloured"],
)
def test_the_official_validator_finds_no_fault(tmp_path, maps):
    export.material_gltf(maps, tmp_path / "planes.glb")
    issues = validated(tmp_path / "planes.glb")["issues"]
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"][:3]


def test_the_validator_does_find_faults(tmp_path):
    export.material_gltf(a_material(), tmp_path / "plane.glb")
    content = (tmp_path / "plane.glb").read_bytes()
    (tmp_path / "broken.glb").write_bytes(content.replace(b"specularColorFactor", b"specularColorFagtor"))
    issues = validated(tmp_path / "broken.glb")["issues"]
    assert issues["numErrors"] + issues["numWarnings"] > 0


def reflectances(file, material):
    """F0 and F90 as KHR_materials_specular has viewers compute them."""
    lobe = material["extensions"]["KHR_materials_specular"]
    colour = np.array(lobe["specularColorFactor"]) * from_srgb(file.pixels(lobe["specularColorTexture"])[..., :3])
    weight = file.pixels(lobe["specularTexture"])[..., 3:]
    return 0.04 * colour * weight, weight


@pytest.mark.parametrize("fresnel, eta", [("eta", 1.5), ("eta", 1.33), ("albedo", 1.5)])
def test_viewers_see_at_grazing_angles_what_was_learned(tmp_path, fresnel, eta):
    """What reflects nothing does not shine from the side: F90 follows F0, in the file as in our renderings."""
    k_s = np.linspace(0, 0.06, 54).astype(np.float32).reshape(6, 9)
    maps = a_material()
    maps[3] = k_s
    export.material_gltf(maps, tmp_path / "one.glb", fresnel=fresnel, eta=eta)
    file = Glb(tmp_path / "one.glb")
    f0, f90 = reflectances(file, file.tree["materials"][0])
    scale, own, grazing = Reflection(fresnel, eta).terms(torch.tensor(k_s))
    np.testing.assert_allclose(f0[..., 0], scale * own, atol=1e-3)
    np.testing.assert_allclose(f90[..., 0], scale * grazing, atol=HALF)


@pytest.mark.parametrize("fresnel, f0", [("eta", UNIT), ("albedo", 1.0)])
@pytest.mark.parametrize("diffuse, specular", [(1.0, 1.0), (1.6, 1.2), (0.5, 0.1)])
@pytest.mark.parametrize("tinted", [False, True])
def test_the_embedded_pictures_hold_the_material(tmp_path, fresnel, f0, diffuse, specular, tinted):
    maps = np.stack([a_material(seed, diffuse=diffuse, specular=specular) for seed in (3, 4)])
    maps = np.stack([coloured(x) for x in maps]) if tinted else maps
    export.material_gltf(maps, tmp_path / "two.glb", fresnel=fresnel)
    file = Glb(tmp_path / "two.glb")
    assert len(file.tree["materials"]) == 2
    for material, x in zip(file.tree["materials"], maps, strict=True):
        want, pbr = expected(x, f0), material["pbrMetallicRoughness"]
        assert pbr["metallicFactor"] == 0 and "baseColorFactor" not in pbr and "roughnessFactor" not in pbr
        assert material["extensions"]["KHR_materials_ior"] == {"ior": 1.5}
        assert (material["extras"]["fresnel"], material["extras"]["eta"]) == (fresnel, 1.5)
        scale = material["extras"]["basecolor_scale"]
        assert scale == pytest.approx(max(1, diffuse))
        np.testing.assert_allclose(file.pixels(pbr["baseColorTexture"]), to_srgb(want["basecolor"] / scale), atol=HALF)
        got, grazing = reflectances(file, material)
        np.testing.assert_allclose(got, np.broadcast_to(want["specular"], got.shape), rtol=0, atol=0.006)
        # The largest of three channels, 1 from k_s = 1 on by the paper's reading, from 0.04 on by the artists'.
        largest = want["specular"].max(-1, keepdims=True) / (0.04 if fresnel == "albedo" else UNIT)
        np.testing.assert_allclose(grazing, largest.clip(max=1), atol=HALF)
        rough = file.pixels(pbr["metallicRoughnessTexture"])
        np.testing.assert_allclose(rough[..., 1:2], want["roughness"], atol=HALF)
        assert (rough[..., 2] == 0).all()
        np.testing.assert_allclose(2 * file.pixels(material["normalTexture"]) - 1, want["normal"], atol=2 * HALF)


def test_the_plane_stands_upright_and_its_frame_is_the_pictures(tmp_path):
    export.material_gltf(a_material(height=4, width=8), tmp_path / "one.glb")
    file = Glb(tmp_path / "one.glb")
    primitive = file.tree["meshes"][0]["primitives"][0]
    places, uv, normals, tangents = (
        file.attribute(primitive, name) for name in ("POSITION", "TEXCOORD_0", "NORMAL", "TANGENT")
    )
    # u to the right with x, v downwards against y: texel rows and columns are the picture's.
    np.testing.assert_allclose(places, np.stack([uv[:, 0] - 0.5, (0.5 - uv[:, 1]) / 2, 0 * uv[:, 0]], 1), atol=1e-7)
    assert (normals == [0, 0, 1]).all() and (tangents == [1, 0, 0, 1]).all()
    bitangents = np.cross(normals, tangents[:, :3]) * tangents[:, 3:]
    assert (bitangents == [0, 1, 0]).all()
    assert file.tree["nodes"][0]["translation"] == [0, 0, 0]


def test_trimesh_reads_planes_that_face_the_viewer_and_do_not_touch(tmp_path):
    export.material_gltf(some(3), tmp_path / "three.glb")
    with open(tmp_path / "three.glb", "rb") as file:
        scene = trimesh.load(file, file_type="glb")
    assert sorted(scene.graph.nodes_geometry) == ["material-00", "material-01", "material-02"]
    places = np.array([scene.graph[name][0][:3, 3] for name in sorted(scene.graph.nodes_geometry)])
    assert (places[:, 2] == 0).all()
    assert places[0, 0] < places[1, 0] and places[0, 1] > places[2, 1]
    for name in scene.graph.nodes_geometry:
        plane = scene.geometry[scene.graph[name][1]]
        np.testing.assert_allclose(plane.face_normals, [[0, 0, 1]] * 2)
        np.testing.assert_allclose(plane.extents, [1, 6 / 9, 0], atol=1e-6)
        # trimesh turns v over: up is up.
        np.testing.assert_allclose(plane.visual.uv[:, 1] - 0.5, plane.vertices[:, 1] * 9 / 6, atol=1e-6)


def test_roughness_that_gltf_cannot_hold_is_its_largest_and_said(tmp_path):
    maps = np.stack([a_material(0), a_material(1, roughness=1.5), a_material(2)])
    with pytest.warns(UserWarning, match=r"^material-01: roughness above 1 is 1 in glTF"):
        written = export.material_gltf(maps, tmp_path)
    assert written.paths == (tmp_path / "materials.glb",) and not written.skipped
    assert [node["name"] for node in Glb(written.paths[0]).tree["nodes"]] == [f"material-0{k}" for k in range(3)]
    glb = Glb(written.paths[0])
    rough = glb.pixels(glb.tree["materials"][1]["pbrMetallicRoughness"]["metallicRoughnessTexture"])[..., 1]
    np.testing.assert_allclose(rough, np.sqrt(maps[1, 4].clip(max=1)), atol=1 / 255)


def test_a_material_of_materialx_has_the_name_of_its_folder(tmp_path):
    for folder, names in (("old oak", ["old_oak"]), ("surface", ["material_surface"]), ("2024", ["material_2024"])):
        export.material_x(a_material(), tmp_path / folder)
        assert surfaces(tmp_path / folder) == names
    export.material_x(some(2), tmp_path / "two")
    assert surfaces(tmp_path / "two") == ["material_00", "material_01"]


def surfaces(folder):
    files = sorted(folder.rglob("*.mtlx"))
    return [node.get("name") for file in files for node in ElementTree.parse(file).getroot().iter("surfacematerial")]


def test_one_material_and_several_do_not_hide_each_other(tmp_path):
    export.material_maps(some(2), tmp_path / "two")
    with pytest.raises(UserError, match=r"two: holds several materials \(material-00, …\), which one beside it"):
        export.material_maps(a_material(), tmp_path / "two")
    export.material_maps(some(2), tmp_path / "two")
    export.material_maps(a_material(), tmp_path / "one")
    with pytest.raises(UserError, match="one: holds a material, which several beside it would hide"):
        export.material_x(some(2), tmp_path / "one")
    export.material_x(a_material(), tmp_path / "one")


def test_gltf_has_eight_bits(tmp_path):
    with pytest.raises(UserError, match="8-bit"):
        export.material_gltf(a_material(), tmp_path / "a.glb", depth="16")
    assert os.listdir(tmp_path) == []


# All of them

TARGETS = {"maps": "out", "mtlx": "out", "gltf": "out.glb"}
FLAT = [0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 1.0]


def flat(n=2, **changed):
    """Flat grey materials; `c4=-1` sets channel 4 of the last."""
    maps = np.tile(np.array(FLAT, np.float32)[:, None, None], (n, 1, 4, 4))
    for channel, value in changed.items():
        maps[-1, int(channel[1:])] = value
    return maps


@pytest.mark.parametrize("to", export.MATERIAL_FORMATS)
@pytest.mark.parametrize(
    "maps, options, says",
    [
        (flat(c0=np.nan), {}, "material-01: diffuse has values that are NaN"),
        (flat(c3=-0.1), {}, "material-01: specular is negative"),
        (flat(c4=0), {}, "material-01: roughness is 0"),
        (flat(c7=-1), {}, "material-01: a normal points into"),
        (flat(1, c6=1), {}, "material: normals are not of unit length"),
        (flat()[:, :7], {}, "give \\(B, 8, H, W\\)"),
        (flat()[0, 0], {}, "give \\(B, 8, H, W\\)"),
        (flat()[:0], {}, "no material in an array"),
        (flat(), {"fresnel": "schlick"}, "use one of eta, albedo"),
        (flat(), {"eta": 1.0}, "above 1"),
        (flat(), {"eta": float("nan")}, "above 1"),
        (flat(), {"depth": "32"}, "depth"),
    ],
)
def test_bad_maps_and_options_are_one_line_and_leave_no_file(tmp_path, to, maps, options, says):
    with pytest.raises(UserError, match=says) as caught:
        export.MATERIAL_FORMATS[to](maps, tmp_path / "deep" / TARGETS[to], **options)
    assert "\n" not in str(caught.value) and os.listdir(tmp_path) == []


@pytest.mark.parametrize("to", export.MATERIAL_FORMATS)
@pytest.mark.parametrize("before", [False, True])
def test_a_disk_that_fills_up_leaves_what_was_there(tmp_path, monkeypatch, to, before):
    path = tmp_path / TARGETS[to]
    if before:
        export.MATERIAL_FORMATS[to](flat(), path)
    old = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    synchronise, count = os.fsync, [0]

    def full(descriptor):
        count[0] += 1
        if count[0] == (1 if to == "gltf" else 7):
            raise OSError(28, "No space left on device")
        synchronise(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        export.MATERIAL_FORMATS[to](flat(c0=0.7), path)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == old
    assert bool(os.listdir(tmp_path)) == before


@pytest.mark.parametrize("to", ["maps", "mtlx"])
def test_a_batch_has_a_folder_each_and_a_second_writing_replaces_the_first(tmp_path, to):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("kept")
    for grey in (0.2, 0.5):
        written = export.MATERIAL_FORMATS[to](flat(3, c0=grey), tmp_path / "out", fresnel="albedo")
    folders = ["material-00", "material-01", "material-02"]
    assert sorted(os.listdir(tmp_path / "out")) == [*folders, "mine.txt"]
    assert sorted(os.listdir(tmp_path)) == ["out"]
    assert [p for p in written.paths if p.name == "material.json"] == [
        tmp_path / "out" / f / "material.json" for f in folders
    ]
    assert all(p.is_file() for p in written.paths) and len(written.paths) == 3 * (5 if to == "maps" else 6)
    assert pillow(tmp_path / "out" / "material-02" / "basecolor.png")[0, 0] == pytest.approx(
        [float(to_srgb(0.5))] * 3, abs=HALF
    )
    assert tmp_path.name not in "".join(p.read_text() for p in written.paths if p.suffix in (".json", ".mtlx"))


def test_maps_of_an_earlier_export_do_not_lie_beside_the_new_ones(tmp_path):
    (tmp_path / "notes").mkdir()
    export.material_x(flat(1), tmp_path, depth="half")
    for name in ("mine.exr", "notes/normal.exr"):
        (tmp_path / name).write_text("kept")
    export.material_maps(flat(1), tmp_path)
    pictures = {f"{name}.png" for name in NAMES}
    assert set(os.listdir(tmp_path)) == {"material.json", *pictures, "mine.exr", "notes"}
    assert os.listdir(tmp_path / "notes") == ["normal.exr"]
    export.material_x(flat(2), tmp_path / "several", depth="float")
    export.material_maps(flat(2), tmp_path / "several")
    assert set(os.listdir(tmp_path / "several" / "material-01")) == {"material.json", *pictures}


@pytest.mark.parametrize("note", [None, "{", "[]", '{"format": "another"}'])
def test_maps_that_are_not_of_an_export_stay(tmp_path, note):
    (tmp_path / "normal.exr").write_text("mine")
    (tmp_path / "material.mtlx").write_text("mine")
    if note is not None:
        (tmp_path / "material.json").write_text(note)
    export.material_maps(flat(1), tmp_path)
    assert (tmp_path / "normal.exr").read_text() == (tmp_path / "material.mtlx").read_text() == "mine"


def test_materials_of_a_larger_batch_are_named(tmp_path):
    export.material_maps(flat(4), tmp_path)
    with pytest.warns(UserWarning, match="material-02 and 1 more are of an earlier export"):
        export.material_maps(flat(2), tmp_path)
    assert (tmp_path / "material-03" / "material.json").is_file()


@pytest.mark.parametrize("to", ["maps", "mtlx"])
def test_a_new_folder_appears_by_one_renaming(tmp_path, monkeypatch, to):
    """A kill at any instant leaves no part of it under its name."""
    rename, seen = os.replace, []

    def watched(source, target):
        seen.append(((tmp_path / "out").exists(), Path(target)))
        rename(source, target)

    monkeypatch.setattr(os, "replace", watched)
    written = export.MATERIAL_FORMATS[to](flat(), tmp_path / "out")
    assert seen[-1] == (False, tmp_path / "out") and all(p.is_file() for p in written.paths)


@pytest.mark.parametrize("to", ["maps", "mtlx"])
def test_the_target_is_a_folder(tmp_path, to):
    (tmp_path / "file").write_text("mine")
    for name in ("file", "wood.png", "wood.mtlx"):
        with pytest.raises(UserError, match="name of a folder"):
            export.MATERIAL_FORMATS[to](flat(), tmp_path / name)
    assert os.listdir(tmp_path) == ["file"] and (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("to", export.MATERIAL_FORMATS)
def test_the_same_material_gives_the_same_bytes(tmp_path, to):
    maps = torch.from_numpy(a_material())
    read_only = a_material()
    read_only.flags.writeable = False
    first = export.MATERIAL_FORMATS[to](maps.requires_grad_(), tmp_path / "a" / TARGETS[to])
    second = export.MATERIAL_FORMATS[to](read_only, tmp_path / "b" / TARGETS[to])
    assert [p.read_bytes() for p in first.paths] == [p.read_bytes() for p in second.paths]
