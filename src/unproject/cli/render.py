"""`unproject render MAPS --view θ[,φ] --light env:FILE|directional:θ,φ|coloured:θ,φ|ambient --out F.(png|npy|gif)`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .._types import UserError
from ._materials import read_maps
from ._threads import use_threads

if TYPE_CHECKING:
    from torch import Tensor

    from ..projections.rendering import Lighting, Rendering

MAX_STRIP = 1000


def run(
    maps: Path,
    /,
    *,
    out: Path,
    view: str = "0",
    light: str = "env:studio",
    samples: int = 256,
    seed: int = 0,
    eta: float | None = None,
    fresnel: Literal["eta", "albedo"] | None = None,
    shadowing: Literal["smith", "cook-torrance"] = "smith",
    space: Literal["texture", "image"] = "texture",
    repeat: bool = False,
    distance: float = 4.0,
    size: int | None = None,
    coloured_specular: bool = False,
    strip: int | None = None,
    threads: int | None = None,
) -> None:
    """Render the maps of a material as a camera sees them that is aimed at their centre.

    Args:
        maps: An .npz as `unproject sample` writes it, or a folder of textures, as ambientCG and Poly Haven
            name them or `export` wrote them.
        out: A .png or .gif, exposed, with gamma 2.2; or an .npy of linear radiance (H, W, 3), (N, H, W, 3) of several.
        view: The camera's angle from the normal and, after a comma, its azimuth (default: -90, the bottom edge).
        light: env:FILE (.hdr, .exr or .npy), env:NAME (sky, overcast, studio, window, night), ambient,
            directional:ANGLE,AZIMUTH or coloured:ANGLE,AZIMUTH (red from there, green and blue 120 and 240 degrees on).
        samples: Samples a pixel, for natural and ambient light.
        seed: Which samples: the same seed gives the same picture.
        eta: The index of refraction, for --fresnel eta (default: 1.5).
        fresnel: eta: the specular map scales a reflectance given by --eta; albedo: it is that reflectance (default:
            what the .npz says in its entry `fresnel`, else eta; albedo for a folder of textures).
        shadowing: Smith's for Beckmann facets, or Cook and Torrance's grooves.
        space: texture: each texel in its own place; image: the perspective picture.
        repeat: With --space image: the material again beside itself.
        distance: Of the camera from the centre, in widths of the material.
        size: Resample textures to so many pixels a side.
        coloured_specular: Of a folder of textures: metals reflect their colour (default: the luminance of it).
        strip: So many pictures side by side (.png) or one after another (.gif): the light goes around, seen from above
            and from --view in turn.
        threads: Processor threads (default: one a core that nobody else keeps busy).
    """
    from ..ops.microfacet import Reflection
    from ..ops.shading import Sampling
    from ..projections.rendering import Rendering

    use_threads(threads)
    _check(out, strip)
    if repeat and space != "image":
        raise UserError("--repeat: is of --space image; each texel in its own place has nothing beside it")
    theta, phi = view_of(view)
    lighting, latents = light_of(light)
    index = 1.5 if eta is None else eta
    reflection, sampling = Reflection(fresnel or "eta", index, shadowing), Sampling(samples)  # mistakes come first
    material = read_maps(maps, size, coloured_specular)
    reflection = Reflection(fresnel or material.fresnel, index, shadowing)
    if eta is not None and reflection.fresnel != "eta":
        raise UserError(f"--eta {eta:g}: the specular map is the reflectance; add --fresnel eta")
    look = Rendering(lighting, reflection, sampling, distance, space, repeat, out.suffix != ".npy")
    frames = [
        _look(look, material.maps, {"view": view_k, "view_azimuth": math.radians(phi), **latents_k}, seed)
        for view_k, latents_k in _frames(math.radians(theta), latents, strip)
    ]
    _write(frames, out)
    material.say_skipped()


def _check(out: Path, strip: int | None) -> None:
    if out.suffix not in (".png", ".npy", ".gif"):
        raise UserError(f"--out {out}: give a name that ends in .png, .npy or .gif")
    if out.suffix == ".gif" and strip is None:
        raise UserError(f"--out {out}: a .gif shows a strip; say --strip 12, or give a .png")
    if strip is not None and (not 1 <= strip <= MAX_STRIP or out.suffix == ".npy"):
        raise UserError(f"--strip {strip}: give 1 to {MAX_STRIP} pictures, and a .png or .gif")


def view_of(text: str) -> tuple[float, float]:
    """Return the angles of a camera above a material from its normal and around it, in degrees."""
    theta, phi = angles("--view ", text, "80 or 80,-90", -90.0)
    if not abs(theta) < 90:
        raise UserError(f"--view {text}: the camera must be above the material, less than 90 degrees from the normal")
    return theta, phi


def angles(flag: str, text: str, example: str, azimuth: float) -> tuple[float, float]:
    parts = text.split(",")
    try:
        theta, phi = float(parts[0]), float(parts[1]) if len(parts) > 1 else azimuth
    except ValueError:
        theta = phi = math.nan
    if len(parts) > 2 or not math.isfinite(theta + phi):
        raise UserError(f"{flag}{text}: give degrees, for example {example}")
    return theta, phi


def light_of(text: str) -> tuple[Lighting | Tensor, dict[str, float]]:
    """What lights, and its latents."""
    kind, _, rest = text.partition(":")
    if kind == "ambient" and not rest:
        return "ambient", {}
    if kind in ("directional", "coloured") and rest:
        theta, phi = angles(f"--light {kind}:", rest, f"{kind}:45,90", 0.0)
        if not abs(theta) < 90:
            raise UserError(f"--light {text}: the light must be above the material, less than 90° from its normal")
        return kind, {"light": math.radians(theta), "light_azimuth": math.radians(phi)}
    if kind == "env" and rest:
        return _environment(rest), {"light": 0.0, "probe": 0.0}
    raise UserError(
        f"--light {text}: give env:FILE, env:NAME, directional:ANGLE,AZIMUTH, coloured:ANGLE,AZIMUTH or ambient"
    )


def _environment(name: str) -> Tensor:
    from ..data import procedural_probes, read_probe

    if Path(name).suffix:
        return read_probe(name)[None]
    probes, names = procedural_probes()
    if name not in names:
        raise UserError(f"--light env:{name}: there is no such light; give a file, or one of {', '.join(names)}")
    return probes[names.index(name)][None]


def _frames(view: float, latents: dict[str, float], strip: int | None) -> list[tuple[float, dict[str, float]]]:
    """View and light latents of each picture: of a strip the light goes around, and every other view is from above."""
    if strip is None:
        return [(view, latents)]
    turned = "light_azimuth" if "light_azimuth" in latents else "light"
    return [
        (view * (k % 2), latents and {**latents, turned: latents[turned] + 2 * math.pi * k / strip})
        for k in range(strip)
    ]


def _look(look: Rendering, material: Tensor, latents: dict[str, float], seed: int) -> Tensor:
    """(N, 3, H, W), a material at a time."""
    import torch

    from .._random import generator_at

    jitter = torch.rand(len(material), generator=generator_at(seed, 0, "render"), dtype=torch.float64)
    pictures = []
    with torch.no_grad():
        for one, which in zip(material, jitter, strict=True):
            theta = {name: torch.tensor([value], dtype=torch.float64) for name, value in latents.items()}
            drawn = {"jitter": which[None]} if "jitter" in look.latents else {}
            pictures.append(look(one[None].float(), **theta, **drawn)[0])
    return torch.stack(pictures)


def _write(frames: list[Tensor], out: Path) -> None:
    import numpy as np
    from PIL import Image

    from .._files import atomic_path

    shown = np.stack([frame.permute(0, 2, 3, 1).numpy() for frame in frames])
    with atomic_path(out) as temporary:
        if out.suffix == ".npy":
            linear = shown[0] if shown.shape[1] > 1 else shown[0, 0]
            with temporary.open("wb") as file:
                np.save(file, linear.astype(np.float32), allow_pickle=False)
        else:
            # Materials below one another, the pictures of a strip beside one another or in time.
            rows = (np.concatenate(list(shown.swapaxes(0, 1)), axis=1) * 255).round().astype(np.uint8)
            if out.suffix == ".png":
                Image.fromarray(np.concatenate(list(rows), axis=1)).save(temporary)
            else:
                first, *others = [Image.fromarray(row) for row in rows]
                first.save(temporary, save_all=True, append_images=others, duration=160, loop=0)
    count, of = shown.shape[0] * shown.shape[1], "picture" if shown.shape[0] * shown.shape[1] == 1 else "pictures"
    print(f"{out}: {count} {of} of {shown.shape[3]}×{shown.shape[2]}")
