"""`shading.shade` on a CPU by `shading.cpp`: the same estimate in float32, ten times faster.

Samples are not stored; the gradient computes them again. Pixels are divided between threads.
"""

from __future__ import annotations

import ctypes
import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ._native import kernel, pointer
from .lights import Directional, Environment, Light
from .low_discrepancy import STEPS
from .maps import CHANNELS, specular_channels
from .microfacet import Reflection, reflectance
from .shading import Plan, Sampling, by_colour, diffuse_counts, plan_samples, shade
from .shading_lamps import shade_lamps

BLOCK = 8
FLOATS = ("maps", "camera", "table", "turn", "pool", "along", "diffuse", "gradient")
COUNTS = ("pixels", "rows", "columns", "lobes", "lights", "stratum")
SWITCHES = ("natural", "independent", "albedo", "fixed")


class Job(ctypes.Structure):
    """`struct Job` of shading.cpp."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in (*FLOATS, "which", "seed", "out")),
        *((name, ctypes.c_int64) for name in COUNTS),
        *((name, ctypes.c_int32) for name in SWITCHES),
        ("f0", ctypes.c_float),
    ]


def shade_fast(
    maps: Tensor, to_camera: Tensor, light: Light, reflection: Reflection, sampling: Sampling, jitter: Tensor
) -> Tensor:
    """Compute `shading.shade`: of lamps by `shade_lamps`, else by the kernel where it supports the arguments."""
    if isinstance(light, Directional):
        return shade_lamps(maps, to_camera, light, reflection)
    if specular_channels(maps) == 3:
        return by_colour(maps, lambda x, k: shade_fast(x, to_camera, light, reflection, sampling, jitter))
    if sampling.gradient == "differences" or not can_shade(maps, to_camera, light, reflection):
        return shade(maps, to_camera, light, reflection, sampling, jitter)
    plan = plan_samples(light, sampling, jitter, maps)
    return shade_native(maps, to_camera, light, reflection, plan, sampling.gradient == "fixed")


def can_shade(maps: Tensor, camera: Tensor, light: Light, reflection: Reflection) -> bool:
    """Return whether the kernel supports this: float32 on a CPU, Smith's shadowing, gradients by the maps only."""
    still = not camera.requires_grad
    if isinstance(light, Environment):
        still = still and not (light.turn.requires_grad or light.environments.table.requires_grad)
    fits = maps.dtype == torch.float32 and maps.device.type == "cpu" and still
    return fits and reflection.shadowing == "smith" and kernel("shading", "shade") is not None


def shade_native(
    maps: Tensor, to_camera: Tensor, light: Light, reflection: Reflection, plan: Plan, fixed: bool
) -> Tensor:
    """Compute radiance (B, 3, H, W) by the kernel; `fixed`: the gradient does not move the samples."""
    return _Shade.apply(maps, to_camera, light, reflection, plan, fixed)


class _Shade(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, maps: Tensor, camera: Tensor, *rest: Any) -> Tensor:
        ctx.save_for_backward(maps, camera)
        ctx.rest = rest
        return _run(maps, camera, *rest)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Any:
        return _run(*ctx.saved_tensors, *ctx.rest, gradient=gradient), None, None, None, None, None


def _run(
    maps: Tensor,
    camera: Tensor,
    light: Light,
    reflection: Reflection,
    plan: Plan,
    fixed: bool,
    gradient: Tensor | None = None,
) -> Tensor:
    batch, _, height, width = maps.shape
    natural = isinstance(light, Environment)
    _check_bounds(maps, camera, light, plan)
    nothing = maps.new_zeros(1)
    sample = torch.arange(plan.lobes, dtype=torch.float64)
    out = maps.new_empty(batch, 3 if gradient is None else CHANNELS, height, width)
    floats = {
        "maps": maps.detach(),
        "camera": camera.detach(),
        "table": light.environments.table if natural else nothing,
        "turn": light.turn if natural else nothing,
        "pool": torch.cat([plan.pool, plan.pool_light, plan.pool_light[..., :1]], -1),
        "along": torch.stack([torch.frac(sample * step) for step in STEPS], -1).float(),
        "diffuse": diffuse_counts(maps, plan.lobes),
        "gradient": gradient,
    }
    kept = {name: None if x is None else x.float().contiguous() for name, x in floats.items()}
    which = light.which.long().contiguous() if natural else plan.seed
    rows, columns = light.environments.size if natural else (0, 0)
    job = Job(
        **{name: None if x is None else pointer(x) for name, x in kept.items()},
        **{"which": pointer(which), "seed": pointer(plan.seed), "out": pointer(out)},
        **dict(zip(COUNTS, (height * width, rows, columns, plan.lobes, plan.lights, plan.stratum), strict=True)),
        **dict(
            zip(SWITCHES, (natural, plan.independent, reflection.fresnel == "albedo", fixed), strict=True),
            f0=reflectance(reflection.eta),
        ),
    )
    _share_out(job, batch * -(-height * width // BLOCK))
    return out


def _check_bounds(maps: Tensor, camera: Tensor, light: Light, plan: Plan) -> None:
    """Check shapes and indices, which the kernel does not."""
    assert maps.shape[1] == CHANNELS
    assert camera.shape == (len(maps), 3, *maps.shape[2:]) and len(plan.seed) == len(plan.pool) == len(maps)
    if isinstance(light, Environment):
        assert light.turn.shape == light.which.shape == (len(maps),)
        assert bool(((light.which >= 0) & (light.which < len(light.environments.table))).all())


def _share_out(job: Job, blocks: int) -> None:
    shade = kernel("shading", "shade")
    assert shade is not None
    threads = min(torch.get_num_threads(), max(1, blocks // 16))
    edges = [ctypes.c_int64(blocks * k // threads) for k in range(threads + 1)]
    if threads == 1:
        shade(ctypes.byref(job), *edges)
    else:
        list(_pool(threads).map(lambda k: shade(ctypes.byref(job), edges[k], edges[k + 1]), range(threads)))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="shading")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a child process has no threads of its parent
