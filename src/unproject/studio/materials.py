"""Materials: the maps at a place of the latents, and a picture of them under a light."""

from __future__ import annotations

import hashlib
import io
import math
import tempfile
from pathlib import Path
from typing import cast, get_args

from PIL import Image
from torch import Tensor

from .. import export
from .._types import UserError
from ..data import procedural_probes, read_probe
from ..data.readers.probes import SUFFIXES, resample_probe
from ..domains import Maps
from ..ops.environment import Environments
from ..ops.maps import unpack_maps
from ..ops.microfacet import Reflection
from ..report.materials import is_material
from ..report.pictures import picture_of
from .answers import Answer, Missing, Request, of_json
from .explore import at_place, space_of
from .lighting import Form, Scene, exposed, picture_of_scene
from .state import State

PLACE = ("run", "pick", "other", "mix", "truncation", "slides")
LAMPS = ("ambient", "directional", "coloured")
FINEST = 256
"""Rows of a dropped environment at most: finer ones light a material alike."""
STEEPEST = 85.0
SAMPLES = 128


def maps_at(state: State, request: Request) -> tuple[Tensor, Maps, int]:
    """Return the material (8 or 10, H, W) at the place of a request, its domain and the step of the weights.

    To be called where it is computed.

    Raises:
        UserError: if the run makes no materials.
    """
    space = space_of(state, request)
    domain = space.run.domain
    key = ("maps", state.version(space.run), *(request.query.get(name) for name in PLACE))
    x = state.kept(key, lambda: at_place(space, request), 16)
    if not isinstance(domain, Maps) or not is_material(domain, x):
        raise UserError(f"{request.text('run')}: makes no materials; choose a run of materials")
    return x[0], domain, space.run.step


def show_maps(state: State, request: Request) -> Answer:
    """Answer with the four maps as pictures, and the names of lights."""
    maps, _, step = state.compute(lambda: maps_at(state, request))
    shown = {}
    for name, part in unpack_maps(maps[None]).items():
        sheet = export.picture_sheet(export.map_picture(name, part), columns=1, cell=256)
        shown[name] = picture_of(sheet, name, 256).uri
    return of_json({"step": step, "maps": shown, "lights": [*state.kept(("probes",), procedural_probes)[1], *LAMPS]})


def render(state: State, request: Request) -> Answer:
    """Answer with the picture of the material, as JPEG."""

    def seen() -> bytes:
        maps, domain, _ = maps_at(state, request)
        picture = picture_of_scene(maps, _scene(state, request), Reflection(domain.fresnel))
        image = Image.fromarray((picture.movedim(0, -1).clamp(0, 1) * 255).round().byte().numpy())
        content = io.BytesIO()
        image.save(content, "JPEG", quality=92, subsampling=0)
        return content.getvalue()

    return Answer(state.compute(seen), "image/jpeg")


def _scene(state: State, request: Request) -> Scene:
    form, light = request.text("form", "ball"), request.text("light", "studio")
    if form not in get_args(Form):
        raise UserError(f"form={form}: choose from {', '.join(get_args(Form))}")
    return Scene(
        cast(Form, form),
        math.radians(request.number("view", 60, 0, STEEPEST)),
        _turned(request, "around", -90),
        light if light in LAMPS else _environment(state, light),
        math.radians(request.number("polar", 45, 0, STEEPEST)),
        _turned(request, "turn", 0),
        request.whole("samples", 32, 2, SAMPLES),
    )


def _turned(request: Request, name: str, default: float) -> float:
    """Return an angle in radians, after however many turns."""
    return math.radians(request.number(name, default, -1e9, 1e9) % 360)


def _environment(state: State, name: str) -> Environments:
    probes, names = state.kept(("probes",), procedural_probes)
    if name in names:
        return state.kept(("environment", name), lambda: exposed(probes[names.index(name)]), 16)

    def missing() -> Environments:
        raise Missing(f"light={name[:80]}: there is no such light; choose one, or drop the .hdr once more")

    return state.kept(("environment", name), missing, 16)


def add_light(state: State, request: Request) -> Answer:
    """Take an environment that was dropped, and answer with its name."""
    suffix = Path(request.text("name")).suffix.lower()
    if suffix not in SUFFIXES:
        raise UserError(f"{request.text('name')[:80]}: a light is a lat-long picture, .hdr, .exr or .npy (H, W, 3)")
    name = f"dropped-{hashlib.sha256(request.body).hexdigest()[:16]}"

    def prepared() -> Environments:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"light{suffix}"
            file.write_bytes(request.body)
            try:
                radiance = read_probe(file)
            except UserError as error:
                raise UserError(str(error).replace(str(file), request.text("name")[:80])) from None
        return exposed(resample_probe(radiance, min(radiance.shape[1], FINEST)))

    state.compute(lambda: state.kept(("environment", name), prepared, 16))
    return of_json({"light": name})
