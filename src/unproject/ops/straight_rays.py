"""Sums of a volume's samples along any straight rays, such as those of a pinhole camera.

A ray has an origin o, in the plane through the centre, and a direction d; its samples are x(o + w d), trilinear, for w
at the centres of n equal cells of [-half_depth, half_depth], nearest first. The sum is linear in the volume, so its
gradient spreads a value over the cells around each sample. `straight_rays.cpp` leaves out the samples outside of the
volume and stores none; the plain reference is `ray_sums_plain`.
"""

from __future__ import annotations

import ctypes
from typing import Any

import torch
from torch import Tensor

from ._native import divided, kernel, pointer
from .resampling import ray_points, sample_volume


class Job(ctypes.Structure):
    """`struct Job` of straight_rays.cpp."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("volume", "origin", "direction", "sums", "of_origin", "of_direction")),
        *((name, ctypes.c_int64) for name in ("batch", "x", "y", "z", "rays", "samples")),
        ("half_depth", ctypes.c_double),
    ]


def straight_ray_sums(volume: Tensor, origin: Tensor, direction: Tensor, samples: int, half_depth: float) -> Tensor:
    """Return the sum of the samples of each ray, (B, ...).

    Differentiable in the volume and, once, in the rays. On a CPU with a compiler by the kernel.

    Args:
        volume: (B, X, Y, Z).
        origin, direction: (B, ..., 3).
        samples, half_depth: n and the depth of the first and last cell's outer faces, in units of d.
    """
    alike = volume.dtype == origin.dtype == direction.dtype and volume.dtype in (torch.float32, torch.float64)
    if volume.device.type != "cpu" or not alike or _kernel("sum", volume) is None:
        return ray_sums_plain(volume, origin, direction, samples, half_depth)
    return _Sums.apply(volume, origin, direction, volume.shape, samples, half_depth, False)


def ray_sums_plain(volume: Tensor, origin: Tensor, direction: Tensor, samples: int, half_depth: float) -> Tensor:
    """Return `straight_ray_sums` by torch alone."""
    return sample_volume(volume, ray_points(origin, direction, samples, half_depth)).sum(-1)


def _kernel(task: str, x: Tensor) -> Any:
    return kernel("straight_rays", f"{task}_{'double' if x.dtype == torch.float64 else 'float'}")


class _Sums(torch.autograd.Function):
    """Volumes (B, X, Y, Z) to sums (B, ...), or, with `back`, its transpose: each is the gradient of the other."""

    @staticmethod
    def forward(
        ctx: Any, values: Tensor, origin: Tensor, direction: Tensor, shape: Any, samples: int, depth: float, back: bool
    ) -> Tensor:
        ctx.save_for_backward(values, origin, direction)
        ctx.rest, ctx.back = (shape, samples, depth), back
        result = values.new_empty(shape if back else origin.shape[:-1])
        volume, sums = (result, values) if back else (values, result)
        _run("spread" if back else "sum", (volume, origin, direction, sums), *ctx.rest)
        return result

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        values, origin, direction = ctx.saved_tensors
        of_values, of_rays = None, (None, None)
        if ctx.needs_input_grad[0]:
            of_values = _Sums.apply(gradient, origin, direction, *ctx.rest, not ctx.back)
        if any(ctx.needs_input_grad[1:3]):
            volume, sums = (gradient, values) if ctx.back else (values, gradient)
            of_rays = _Slopes.apply(volume, origin, direction, sums, *ctx.rest)
        return of_values, *of_rays, None, None, None, None


class _Slopes(torch.autograd.Function):
    """Gradients of ⟨sums, g⟩ by origins and directions, which are not differentiated again."""

    @staticmethod
    def forward(
        ctx: Any, volume: Tensor, origin: Tensor, direction: Tensor, g: Tensor, shape: Any, samples: int, depth: float
    ) -> tuple[Tensor, Tensor]:
        by, along = (torch.zeros(part.shape, dtype=part.dtype) for part in (origin, direction))
        _run("slope", (volume, origin, direction, g, by, along), shape, samples, depth)
        return by * g.unsqueeze(-1), along * g.unsqueeze(-1)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        raise NotImplementedError("the second derivative of sums along rays by the rays is not implemented")


def _run(task: str, tensors: tuple[Tensor, ...], shape: Any, samples: int, depth: float) -> None:
    """Run the kernel on (B, ...) tensors, the batch divided between torch's threads."""
    tensors = tuple(tensor.contiguous() for tensor in tensors)
    call, rays = _kernel(task, tensors[0]), tensors[1].shape[1:-1].numel()

    def part(start: int, end: int) -> None:
        pointers = [pointer(tensor[start:end]) for tensor in tensors]
        nothing = [None] * (6 - len(pointers))
        call(ctypes.byref(Job(*pointers, *nothing, end - start, *shape[1:], rays, samples, depth)))

    divided(shape[0], part)
