"""Rendering materials, 64², batch 8, 32 samples a pixel under an environment, forward + backward.

Our kernel, the same estimator in plain eager PyTorch (nothing recomputed, all samples at once) and Mitsuba 3's LLVM
variant take turns in one run on the same number of threads. Mitsuba needs LLVM (`make bench` unpacks Debian's libllvm19
into the environment); without it that line is left out. `python benchmarks/rendering.py --probe FILE.hdr` measures
noise under a real light.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from unproject._random import generator_at
from unproject.data import read_probe
from unproject.ops import shading
from unproject.ops.environment import look_up, prepare_environments
from unproject.ops.lights import Environment
from unproject.ops.microfacet import Reflection
from unproject.ops.plane import to_camera, towards
from unproject.ops.shading import Sampling, pixels_of, reflected, shade
from unproject.ops.shading_native import shade_fast

SIDE, BATCH, SAMPLES, REPEATS = 64, 8, 32, 5
MODEL = Reflection("albedo")


def materials(batch: int = BATCH, side: int = SIDE) -> Tensor:
    x = torch.rand(batch, 8, side, side, generator=generator_at(0))
    x[:, :3] *= 0.8
    x[:, 3] *= 0.5
    x[:, 4] = 0.1 + 0.5 * x[:, 4]
    normal = torch.cat([0.2 * x[:, 5:7] - 0.1, torch.ones_like(x[:, :1])], 1)
    x[:, 5:] = normal / normal.norm(dim=1, keepdim=True)
    return x


def scene(batch: int = BATCH, side: int = SIDE) -> tuple[Tensor, Environment]:
    theta = torch.full((batch,), 0.64)
    probe = torch.rand(1, 3, 64, 128, generator=generator_at(1)) ** 4
    light = Environment(prepare_environments(probe), torch.zeros(batch, dtype=torch.long), torch.zeros(batch))
    return to_camera(theta, torch.full_like(theta, -1.57), 4.0, side, side), light


def step(look: Callable[..., Tensor], x: Tensor, samples: int, gradient: str = "exact") -> float:
    camera, light = scene(*x.shape[:1], x.shape[2])
    options = Sampling(samples, 0.5, gradient=gradient)  # pyright: ignore[reportArgumentType]
    x, jitter = x.clone().requires_grad_(), torch.full(x.shape[:1], 0.3)
    start = time.perf_counter()
    torch.autograd.grad(look(x, camera, light, MODEL, options, jitter).sum(), x)
    return time.perf_counter() - start


def plain(*arguments: Any) -> Tensor:
    """The reference without its sparing of memory: every sample at once, everything kept for the gradient."""
    kept = shading.CHUNK, shading.CHUNK_OF_GPU, shading.checkpoint
    shading.CHUNK = shading.CHUNK_OF_GPU = 2**40
    shading.checkpoint = lambda f, *given, **_: f(*given)
    try:
        return shade(*arguments)
    finally:
        shading.CHUNK, shading.CHUNK_OF_GPU, shading.checkpoint = kept


def mitsuba(threads: int) -> float | None:
    """The least of two seconds of a process of its own, or None without Mitsuba or LLVM."""
    found = sorted(Path(sys.prefix).glob("llvm/**/libLLVM*.so*"))
    environment = os.environ | ({"DRJIT_LIBLLVM_PATH": str(found[0])} if found else {})
    script = Path(__file__).with_name("mitsuba_speed.py")
    numbers = map(str, (SIDE, BATCH, SAMPLES, threads, 2))
    done = subprocess.run([sys.executable, str(script), *numbers], capture_output=True, text=True, env=environment)
    return min(json.loads(done.stdout)["seconds"]) if done.returncode == 0 else None


def peak(samples: int) -> int:
    """MiB of the largest size of a process that does one step."""
    code = f"import rendering as r, resource; r.step(r.shade_fast, r.materials(), {samples}); print(r.usage())"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parent
    )
    return int(done.stdout)


def usage() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def run() -> dict[str, Any]:
    x, times = materials(), {"kernel": [], "kernel_fixed": [], "eager": [], "mitsuba": []}
    step(shade_fast, x, SAMPLES)
    for _ in range(REPEATS):
        times["kernel"].append(step(shade_fast, x, SAMPLES))
        times["kernel_fixed"].append(step(shade_fast, x, SAMPLES, "fixed"))
        times["eager"].append(step(plain, x, SAMPLES))
        times["mitsuba"].append(mitsuba(torch.get_num_threads()))
    median = {name: statistics.median(values) for name, values in times.items() if None not in values}
    ratios = {f"{name}_over_kernel": value / median["kernel"] for name, value in median.items() if name != "kernel"}
    memory = {f"peak_mib_at_{samples}_samples": peak(samples) for samples in (8, 32, 512)}
    return {"threads": torch.get_num_threads(), "seconds": median, **ratios, **memory}


def noise(path: Path, repeats: int = 400) -> list[dict[str, float]]:
    """Variance of 32 samples over that of 32 uniform directions of the hemisphere, by roughness and view."""
    ready = prepare_environments(read_probe(path)[None])
    light = Environment(ready, torch.zeros(repeats, dtype=torch.long), torch.zeros(repeats))
    rows = []
    for roughness in (0.05, 0.1, 0.3, 0.6):
        for view in (0.0, 45.0, 80.0):
            x = torch.zeros(repeats, 8, 1, 1)
            x[:, :3], x[:, 3], x[:, 4], x[:, 7] = 0.4, 0.5, roughness, 1
            theta = torch.full((repeats,), view).deg2rad()
            camera = to_camera(theta, torch.full_like(theta, -1.57), 4.0, 1, 1)
            jitter = torch.rand(repeats, generator=generator_at(2))
            ours = shade_fast(x, camera, light, MODEL, Sampling(SAMPLES), jitter)[:, :, 0, 0].mean(1)
            u = torch.rand(repeats, SAMPLES, 2, generator=generator_at(3))
            d = towards(u[..., 0].acos(), 2 * torch.pi * u[..., 1])
            value = (
                reflected(pixels_of(x, camera), d[:, None], MODEL)[:, 0]
                * look_up(light.environments, light.which, light.turn, d)[0]
            )
            uniform = (value * 2 * torch.pi).mean((1, 2))
            rows.append({"roughness": roughness, "view": view, "ratio": float(ours.var() / uniform.var())})
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--probe", type=Path)
    options = parser.parse_args()
    print(json.dumps(noise(options.probe) if options.probe else run(), indent=1))
