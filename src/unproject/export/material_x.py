"""MaterialX: the folder of maps, and material.mtlx beside them that wires them into a standard_surface.

The surface's specular lobe is a dielectric's, weight · colour · F(cosine, IOR), over a diffuse lobe dimmed by
weight · F. Ours has F0 at normal incidence, so the specular map drives the weight, and

    F0 = specular · specular_color · ((IOR - 1) / (IOR + 1))²

holds with colour 1 and
  - IOR = eta and weight = k_s while fresnel is "eta" and no k_s exceeds 1: exact at grazing angles too;
  - else the IOR whose reflectance is the largest F0 of the map, and weights in proportion. An IOR for more than 0.9
    is beyond tools, so what lies above goes into specular_color.
Of a coloured F0 the weight has the largest of the three, and specular_color is F0 over it.
The lobe's distribution is GGX with alpha = specular_roughness², ours Beckmann with the same alpha.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from numpy.typing import ArrayLike

from unproject.export._volumes import Written, save
from unproject.export.materials import (
    Fresnel,
    MapDepth,
    Material,
    Sheet,
    as_materials,
    storage_of,
    unit_reflectance,
    write_folders,
    write_maps,
)

# The oldest version in use: newer libraries read it, older ones refuse newer files.
VERSION = "1.38"
# F0 at weight 1 is within these: too near to 1 the IOR in the file has no digits left, too far above no tool takes it.
_LEAST, _MOST = 1e-4, 0.9
# The least value by which a coloured F0 is divided.
_DARK = 1e-6


class Lobe(NamedTuple):
    """The constants beside the specular map: a weight of 1 reflects color · ((ior - 1) / (ior + 1))² at F0."""

    ior: float
    color: float

    @property
    def reflectance(self) -> float:
        """F0 at weight 1."""
        return self.color * ((self.ior - 1) / (self.ior + 1)) ** 2


def material_x(
    maps: ArrayLike,
    path: str | PathLike[str],
    *,
    names: Sequence[str] | None = None,
    depth: MapDepth = "8",
    fresnel: Fresnel = "albedo",
    eta: float = 1.5,
) -> Written:
    """`material_maps`, and material.mtlx in each folder, whose material has the name of the folder."""
    materials, storage = as_materials(maps, fresnel, eta, names), storage_of(depth)

    def write(folder: Path, material: Material) -> None:
        sheets = write_maps(folder, material, storage, fresnel, eta)
        lobe = lobe_for(float(material.specular.max()), fresnel, eta)
        name = valid_name(folder.name if len(materials) > 1 else Path(path).absolute().name)
        save(folder / "material.mtlx", document(sheets, lobe, material.specular.shape[-1] == 3, name))

    return write_folders(materials, path, write, names is None)


def lobe_for(largest: float, fresnel: Fresnel, eta: float) -> Lobe:
    """The lobe whose weights reach, and do not exceed, 1 where F0 is `largest`; see the module."""
    if fresnel == "eta" and largest <= unit_reflectance(fresnel, eta) * (1 + 1e-6):
        return Lobe(eta, 1)
    root = math.sqrt(min(max(largest, _LEAST), _MOST))
    return Lobe((1 + root) / (1 - root), max(1, largest / _MOST))


def valid_name(name: str) -> str:
    """A name that MaterialX and USD take: letters, digits and underscores, and no other node's."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"material_{plain}" if plain in ("", "maps", "surface") or plain[0].isdigit() else plain


def document(sheets: dict[str, Sheet], lobe: Lobe, coloured: bool = False, called: str = "material") -> str:
    """The text of material.mtlx for maps that lie beside it; `coloured`: the specular picture has three channels."""
    root = ElementTree.Element("materialx", version=VERSION, colorspace="lin_rec709")
    graph = _node(root, "nodegraph", "maps")
    made = {
        "base_color": _image(graph, "basecolor", "color3", sheets["basecolor"], sheets["basecolor"].scale),
        **_specular(graph, sheets["specular"], lobe, coloured),
        "specular_roughness": _image(graph, "roughness", "float", sheets["roughness"], sheets["roughness"].scale),
        "normal": _normal(graph, sheets["normal"]),
    }
    for name, (kind, node) in made.items():
        _node(graph, "output", f"{name}_out", kind, nodename=node)
    surface = _node(root, "standard_surface", "surface", "surfaceshader")
    for name, value in {"base": 1.0, "metalness": 0.0, "specular_IOR": lobe.ior}.items():
        _node(surface, "input", name, "float", value=_number(value))
    if not coloured:
        _node(surface, "input", "specular_color", "color3", value=", ".join([_number(lobe.color)] * 3))
    for name, (kind, _) in made.items():
        _node(surface, "input", name, kind, nodegraph="maps", output=f"{name}_out")
    material = _node(root, "surfacematerial", called, "material")
    _node(material, "input", "surfaceshader", "surfaceshader", nodename="surface")
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _node(
    parent: ElementTree.Element, tag: str, name: str, kind: str | None = None, **attributes: str
) -> ElementTree.Element:
    typed = {} if kind is None else {"type": kind}
    return ElementTree.SubElement(parent, tag, {"name": name, **typed, **attributes})


def _image(graph: ElementTree.Element, name: str, kind: str, sheet: Sheet, factor: float) -> tuple[str, str]:
    """A picture times a factor, as (type, node); colours alone have a colour space."""
    space = {"sRGB": "srgb_texture", "linear": "lin_rec709"}[sheet.encoding]
    image = _node(graph, "image", name, kind)
    _node(image, "input", "file", "filename", value=sheet.file, **({"colorspace": space} if kind == "color3" else {}))
    if factor == 1:
        return kind, name
    return _operation(graph, "multiply", f"{name}_scaled", (kind, name), factor)


def _operation(
    graph: ElementTree.Element, what: str, name: str, first: tuple[str, str], second: str | float
) -> tuple[str, str]:
    """An operation on the result of a node, (type, name), and a float: a number or that of another node."""
    kind, node = first
    made = _node(graph, what, name, kind)
    _node(made, "input", "in1", kind, nodename=node)
    _node(
        made,
        "input",
        "in2",
        "float",
        **({"nodename": second} if isinstance(second, str) else {"value": _number(second)}),
    )
    return kind, name


def _specular(graph: ElementTree.Element, sheet: Sheet, lobe: Lobe, coloured: bool) -> dict[str, tuple[str, str]]:
    """The weight; and of a coloured F0 its largest channel as the weight, and the colour."""
    factor = sheet.scale / lobe.reflectance
    if not coloured:
        return {"specular": _image(graph, "specular", "float", sheet, factor)}
    image = _image(graph, "specular", "color3", sheet, 1)
    largest = "float", "specular_0"
    for k in range(3):
        channel = _node(graph, "extract", f"specular_{k}", "float")
        _node(channel, "input", "in", "color3", nodename=image[1])
        _node(channel, "input", "index", "integer", value=str(k))
        largest = _operation(graph, "max", f"specular_max_{k}", largest, f"specular_{k}" if k else _DARK)
    hue = _operation(graph, "divide", "specular_hue", image, largest[1])
    return {
        "specular": _operation(graph, "multiply", "specular_scaled", largest, factor),
        "specular_color": _operation(graph, "multiply", "specular_hue_scaled", hue, lobe.color),
    }


def _normal(graph: ElementTree.Element, sheet: Sheet) -> tuple[str, str]:
    kind, image = _image(graph, "normal_map", "vector3", sheet, 1)
    node = _node(graph, "normalmap", "bent_normal", kind)
    _node(node, "input", "in", kind, nodename=image)
    return kind, "bent_normal"


def _number(value: float) -> str:
    return f"{value:.9g}"
