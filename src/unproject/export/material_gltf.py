"""glTF binary: an upright plane for each material, for Blender, Unity, Unreal and the web.

The plane faces z with y up, its longer side 1; the picture's row 0 is its top edge, x of the picture is the tangent
and y the bitangent. The material is dielectric, with the reflectance in KHR_materials_specular:

    F90 = w = specularTexture's alpha
    F0 = 0.04 · specularColorFactor · specularColorTexture · w,    KHR_materials_ior 1.5 being the 0.04

with w = k_s if fresnel is "eta", and F0 / 0.04 if it is "albedo", at most 1, as `ops.microfacet` has it; of a coloured
k_s its largest. The format has 8-bit textures and no base colour, roughness or reflectance above 1. A base colour above
1 is divided by its scale, which the material's extras state; F0 above 1 is in the file and viewers stop at 1; m above 1
is 1, with a warning. Viewers have a GGX lobe with alpha = r² where ours is Beckmann's.
"""

from __future__ import annotations

import io
import json
import struct
import warnings
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from unproject._types import UserError
from unproject.export._volumes import Written, floor_grid, save, within
from unproject.export.materials import Fresnel, Material, as_materials, scale_of, to_srgb, unit_reflectance
from unproject.ops.microfacet import BRIGHT

_SPACING = 1.1
_IOR = 1.5
_F0 = 0.04
_FLOAT, _UNSIGNED_SHORT = 5126, 5123
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_LINEAR, _LINEAR_MIPMAP_LINEAR, _REPEAT = 9729, 9987, 10497


def material_gltf(
    maps: ArrayLike,
    path: str | PathLike[str],
    *,
    names: Sequence[str] | None = None,
    depth: Literal["8"] = "8",
    fresnel: Fresnel = "albedo",
    eta: float = 1.5,
) -> Written:
    """One .glb of planes, several in rows from the top left; a path without .glb gets materials.glb in that folder.

    `names` are those of the planes.

    Raises:
        UserError: maps that are no material, or another depth. OSError: the disk; no file is left half-written.

    Warns:
        UserWarning: of roughness above 1, where glTF ends: it is 1 in the file.
    """
    if depth != "8":
        raise UserError(f"depth {depth!r}: a .glb holds 8-bit pictures; leave depth out, or export maps or mtlx")
    materials = as_materials(maps, fresnel, eta, names)
    if rough := [name for name, material in materials.items() if material.roughness.max() > 1]:
        warnings.warn(f"{', '.join(rough)}: roughness above 1 is 1 in glTF; --to maps and mtlx keep it", stacklevel=2)
    clamped = {name: one._replace(roughness=one.roughness.clip(max=1)) for name, one in materials.items()}
    content = _Glb(clamped, {"fresnel": fresnel, "eta": eta}).content()
    return Written((save(within(Path(path), ".glb", "materials.glb"), content),))


class _Glb:
    """A glTF tree and its binary chunk, grown plane by plane."""

    def __init__(self, materials: dict[str, Material], extras: dict[str, Any]) -> None:
        self.binary = bytearray()
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "unproject"},
            "extensionsUsed": ["KHR_materials_ior", "KHR_materials_specular"],
            "scene": 0,
            "scenes": [{"nodes": list(range(len(materials)))}],
            "samplers": [
                {"magFilter": _LINEAR, "minFilter": _LINEAR_MIPMAP_LINEAR, "wrapS": _REPEAT, "wrapT": _REPEAT}
            ],
            **{key: [] for key in ("nodes", "meshes", "materials", "textures", "images", "accessors", "bufferViews")},
        }
        height, width, _ = next(iter(materials.values())).basecolor.shape
        plane = self._plane(width / max(width, height), height / max(width, height))
        for (name, material), (x, y) in zip(materials.items(), floor_grid(len(materials), _SPACING), strict=True):
            surface = self._add("materials", self._material(name, material, extras))
            mesh = self._add("meshes", {"name": name, "primitives": [{**plane, "material": surface}]})
            self._add("nodes", {"name": name, "mesh": mesh, "translation": [x, y, 0.0]})

    def content(self) -> bytes:
        """The file: a header, the tree as JSON, the binary chunk."""
        binary = bytes(self.binary) + b"\0" * (-len(self.binary) % 4)
        text = json.dumps({**self.tree, "buffers": [{"byteLength": len(binary)}]}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _add(self, key: str, value: dict[str, Any]) -> int:
        self.tree[key].append(value)
        return len(self.tree[key]) - 1

    def _view(self, content: bytes, **more: int) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content), **more}
        self.binary += content
        return self._add("bufferViews", view)

    def _plane(self, width: float, height: float) -> dict[str, Any]:
        """Two triangles; glTF's texture coordinates run right and down, from the picture's top left corner."""
        corners = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], "<f4")
        x, y = (corners[:, 0] - 0.5) * width, (0.5 - corners[:, 1]) * height
        places = np.stack([x, y, 0 * x], 1)
        attributes = {
            "POSITION": self._accessor(places, "VEC3", min=places.min(0).tolist(), max=places.max(0).tolist()),
            "NORMAL": self._accessor(np.tile([0, 0, 1], (4, 1)), "VEC3"),
            "TANGENT": self._accessor(np.tile([1, 0, 0, 1], (4, 1)), "VEC4"),
            "TEXCOORD_0": self._accessor(corners, "VEC2"),
        }
        view = self._view(np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes(), target=_ELEMENT_ARRAY_BUFFER)
        indices = {"bufferView": view, "componentType": _UNSIGNED_SHORT, "count": 6, "type": "SCALAR"}
        return {"attributes": attributes, "indices": self._add("accessors", indices)}

    def _accessor(self, values: np.ndarray, kind: str, **bounds: list[float]) -> int:
        view = self._view(values.astype("<f4").tobytes(), target=_ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": _FLOAT, "count": len(values), "type": kind, **bounds}
        return self._add("accessors", accessor)

    def _texture(self, name: str, pixels: np.ndarray) -> dict[str, int]:
        """(H, W, 3 or 4) in [0, 1] as an embedded 8-bit PNG."""
        file = io.BytesIO()
        Image.fromarray(np.round(255 * pixels).astype(np.uint8)).save(file, "PNG")
        image = self._add("images", {"name": name, "mimeType": "image/png", "bufferView": self._view(file.getvalue())})
        return {"index": self._add("textures", {"sampler": 0, "source": image})}

    def _material(self, name: str, material: Material, extras: dict[str, Any]) -> dict[str, Any]:
        base, r = scale_of(material.basecolor), material.roughness
        rough = np.concatenate([np.ones_like(r), r, np.zeros_like(r)], -1)
        weight, colour = _reflectance(material.specular, _full(**extras))
        brightest = float(colour.max())
        reflected = self._texture(f"{name} specular", np.concatenate([to_srgb(colour / brightest), weight], -1))
        specular = {
            "specularTexture": reflected,
            "specularColorFactor": [brightest] * 3,
            "specularColorTexture": reflected,
        }
        return {
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorTexture": self._texture(f"{name} basecolor", to_srgb(material.basecolor / np.float32(base))),
                "metallicFactor": 0,
                "metallicRoughnessTexture": self._texture(f"{name} roughness", rough),
            },
            "normalTexture": self._texture(f"{name} normal", (material.normal + 1) / 2),
            "extensions": {"KHR_materials_specular": specular, "KHR_materials_ior": {"ior": _IOR}},
            "extras": {**extras, "basecolor_scale": base},
        }


def _full(fresnel: Fresnel, eta: float) -> float:
    """F0 from which on F90 is 1."""
    return BRIGHT if fresnel == "albedo" else unit_reflectance(fresnel, eta)


def _reflectance(f0: np.ndarray, full: float) -> tuple[np.ndarray, np.ndarray]:
    """The weight (H, W, 1), F90, as 8 bits have it, and the colour (H, W, 3) for which F0 = 0.04 · colour · weight."""
    weight = np.round(255 * (f0.max(-1, keepdims=True) / full).clip(max=1)) / 255
    colour = np.where(weight > 0, f0 / (_F0 * np.maximum(weight, 1 / 255)), 1)
    return weight, np.broadcast_to(colour, (*weight.shape[:2], 3))
