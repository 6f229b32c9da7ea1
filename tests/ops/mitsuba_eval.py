"""Run beside the tests, in a process of its own: Mitsuba's rough conductor and rough environment at given directions.

    python mitsuba_eval.py IN.npz OUT.npz

IN holds alpha (M,), o (M, 3), i (M, S, 3); OUT gets `lobe` (M, S), its BSDF times the cosine of i, a Fresnel term of 1.
"""

from __future__ import annotations

import sys

import mitsuba as mi
import numpy as np


def main(source: str, target: str) -> None:
    mi.set_variant("scalar_rgb")
    given = np.load(source)
    lobe = np.zeros(given["i"].shape[:2])
    context = mi.BSDFContext()
    for k, alpha in enumerate(given["alpha"]):
        bsdf = mi.load_dict(
            {"type": "roughconductor", "material": "none", "distribution": "beckmann", "alpha": float(alpha)}
        )
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = mi.Vector3f(*given["o"][k].tolist())
        for s, direction in enumerate(given["i"][k].tolist()):
            lobe[k, s] = bsdf.eval(context, interaction, mi.Vector3f(*direction))[0]
    np.savez(target, lobe=lobe)


if __name__ == "__main__":
    main(*sys.argv[1:])
