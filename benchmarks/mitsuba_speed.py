"""Run by rendering.py in a process of its own: seconds of Mitsuba 3's LLVM variant for one step, forward and backward.

    python mitsuba_speed.py SIDE BATCH SAMPLES THREADS REPEATS

One plane, BATCH materials of SIDE² texels side by side, each map a texture with a gradient: a diffuse and a rough
conductor part blended, a normal map, a lat-long environment. The sensor looks down on it aslant and is as wide and as
high as the plane, so that each pixel has a texel of its own. The `direct` integrator takes one light and one BSDF
sample each, so SAMPLES / 2 a pixel.
"""

from __future__ import annotations

import json
import sys
import time

import drjit as dr
import mitsuba as mi
import numpy as np


def texture(values: np.ndarray) -> dict[str, object]:
    bitmap = mi.Bitmap(values.astype(np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest"}


def scene(side: int, batch: int) -> mi.Scene:
    rng, shape = np.random.default_rng(0), (side, side * batch)
    normal = np.ones((*shape, 3)) * [0.5, 0.5, 1.0]
    normal[..., :2] += 0.1 * rng.random((*shape, 2))
    parts = {
        "a": {"type": "diffuse", "reflectance": texture(0.8 * rng.random((*shape, 3)))},
        "b": {
            "type": "roughconductor",
            "material": "none",
            "distribution": "beckmann",
            "alpha": texture(0.1 + 0.5 * rng.random((*shape, 1))),
            "specular_reflectance": texture(0.5 * rng.random((*shape, 3))),
        },
    }
    aslant = 0.8  # what of the plane's height is left: the cosine of the angle between its normal and the camera
    camera = mi.ScalarTransform4f().look_at([0, -2.4, 3.2], [0, 0, 0], [0, 0, 1])
    camera = camera @ mi.ScalarTransform4f().scale([batch / 2, aslant * batch / 2, 1])
    film = {"type": "hdrfilm", "width": shape[1], "height": side, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "light": {"type": "envmap", "bitmap": mi.Bitmap(rng.random((64, 128, 3)).astype(np.float32) ** 4)},
            "sensor": {"type": "orthographic", "to_world": camera, "film": film},
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale([batch / 2, 0.5, 1]),
                "bsdf": {
                    "type": "normalmap",
                    "normalmap": texture(normal),
                    "bsdf": {"type": "blendbsdf", "weight": 0.5, **parts},
                },
            },
        }
    )


def main(side: int, batch: int, samples: int, threads: int, repeats: int) -> None:
    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(threads)
    world = scene(side, batch)
    parameters = mi.traverse(world)
    maps = [key for key in parameters.keys() if key.endswith(".data") and "plane" in key]  # noqa: SIM118
    seconds = []
    for k in range(repeats + 1):  # the first compiles
        for key in maps:
            dr.enable_grad(parameters[key])
        parameters.update()
        start = time.perf_counter()
        picture = mi.render(world, parameters, spp=samples // 2, seed=k, seed_grad=k + 1000)
        dr.backward(dr.sum(picture.array))
        dr.eval([dr.grad(parameters[key]) for key in maps])
        dr.sync_thread()
        seconds.append(time.perf_counter() - start)
        for key in maps:
            dr.disable_grad(parameters[key])
    print(json.dumps({"maps": len(maps), "seconds": seconds[1:]}))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
