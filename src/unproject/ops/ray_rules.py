"""Occupancy rules along the rays of orthographic cameras, by a kernel that stores no samples.

`ray_rules.cpp` walks along each ray of a plane for all heights at once, and takes what a rule needs of its samples; the
gradient walks along it again. Values are those of `azimuth.ray_samples` with the rules of `occupancy`, which is the
plain reference, and what runs without a compiler. On a GPU the kernels are those of `ray_rules_triton`.
"""

from __future__ import annotations

import ctypes
from typing import Any, Literal, TypeAlias, get_args

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ._native import divided, gpu_kernels, kernel
from .azimuth import PlaneRays, ray_samples, ray_sums
from .occupancy import any_occupied, capped_sum
from .rotation import cos_sin

RayRule: TypeAlias = Literal["samples", "sum", "any", "alpha"]
RAY_RULES = get_args(RayRule)
TENSORS = ("volume", "values", "gradient", "passed", "cosine", "sine", "viewport", "offset")
COUNTS = ("batch", "x", "y", "z", "size", "samples", "of_item", "of_x", "of_y", "of_z")
STRIDES = ("per_item", "per_pixel", "per_sample", "per_height")
LENGTHS = ("half_depth", "half_width", "half_length")


class Job(ctypes.Structure):
    """`struct Job` of ray_rules.cpp."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in TENSORS),
        *((name, ctypes.c_int64) for name in (*COUNTS, *STRIDES)),
        *((name, ctypes.c_double) for name in LENGTHS),
    ]


def ray_values(volume: Tensor, rays: PlaneRays, rule: RayRule) -> Tensor:
    """Return what a rule makes of the samples of each ray.

    "samples" and "sum" are differentiable in the volume twice, "any" and "alpha" once, all once in the azimuth.

    Args:
        volume: (B, X, Y, Z).
        rays: in its planes (X, Z).
        rule: "samples" (B, size, samples, Y), their "sum" (B, size, Y), or "any" and "alpha" of `occupancy`, likewise.

    Examples:
        >>> import torch
        >>> from unproject.ops.azimuth import PlaneRays
        >>> from unproject.ops.ray_rules import ray_values
        >>> rays = PlaneRays(torch.zeros(1), (2, 2), size=2, viewport=1.0, samples=4, half_depth=2.0)
        >>> ray_values(torch.ones(1, 2, 1, 2), rays, "sum").flatten()
        tensor([2., 2.])
    """
    fixed = not any(isinstance(place, Tensor) and place.requires_grad for place in (rays.viewport, rays.offset))
    alike = volume.dtype == rays.azimuth.dtype and volume.dtype in (torch.float32, torch.float64)
    if not fixed or not alike or not _has_kernels(volume):
        return ray_values_plain(volume, rays, rule)
    if rule in ("samples", "sum"):
        return _Linear.apply(volume, rays.azimuth, rays, rule, False)
    return _Nonlinear.apply(volume, rays.azimuth, rays, rule)


def ray_values_plain(volume: Tensor, rays: PlaneRays, rule: RayRule) -> Tensor:
    """Return `ray_values` by torch alone."""
    if rule == "sum":
        return ray_sums(volume, rays)
    samples = ray_samples(volume, rays)
    return samples if rule == "samples" else {"any": any_occupied, "alpha": capped_sum}[rule](samples, 2)


def _has_kernels(volume: Tensor) -> bool:
    if volume.device.type == "cpu":
        return _kernel("sum", "forward", volume) is not None
    return gpu_kernels("ray_rules", volume) is not None


def _kernel(rule: str, task: str, x: Tensor) -> Any:
    return kernel("ray_rules", f"{rule}_{task}_{'double' if x.dtype == torch.float64 else 'float'}")


class _Linear(torch.autograd.Function):
    """Volumes (B, X, Y, Z) to samples or their sums, or, with `back`, its transpose: each is the other's gradient."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, azimuth: Tensor, rays: PlaneRays, rule: RayRule, back: bool) -> Tensor:
        ctx.save_for_backward(values if ctx.needs_input_grad[1] else None, azimuth)  # a slope alone needs them
        ctx.rest, ctx.back = (rays, rule), back
        if back:
            return _back(rays, rule, values, None, None)
        return _forward(rays, rule, values)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        values, azimuth = ctx.saved_tensors
        of_values, of_azimuth = None, None
        if ctx.needs_input_grad[0]:
            of_values = _Linear.apply(gradient, azimuth, *ctx.rest, not ctx.back)
        if ctx.needs_input_grad[1]:
            volume, of = (gradient, values) if ctx.back else (values, gradient)
            of_azimuth = _Slope.apply(volume, of, azimuth, *ctx.rest)
        return of_values, of_azimuth, None, None, None


class _Slope(torch.autograd.Function):
    """The gradient by the azimuth, which is not differentiated again."""

    @staticmethod
    def forward(ctx: Any, volume: Tensor, of: Tensor, azimuth: Tensor, rays: PlaneRays, rule: RayRule) -> Tensor:
        return _slope(rays, rule, volume, of, None)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        raise NotImplementedError("the second derivative of samples along rays by the azimuth is not implemented")


class _Nonlinear(torch.autograd.Function):
    """Volumes to values of "any" or "alpha"."""

    @staticmethod
    def forward(ctx: Any, volume: Tensor, azimuth: Tensor, rays: PlaneRays, rule: RayRule) -> Tensor:
        found = _forward(rays, rule, volume)
        ctx.save_for_backward(volume, found if rule == "any" else volume.new_empty(0))
        ctx.rest = rays, rule
        return 1 - found if rule == "any" else found

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Any:
        volume, passed = ctx.saved_tensors
        rays, rule = ctx.rest
        of_volume = _back(rays, rule, gradient, volume, passed) if ctx.needs_input_grad[0] else None
        of_azimuth = _slope(rays, rule, volume, gradient, passed) if ctx.needs_input_grad[1] else None
        return of_volume, of_azimuth, None, None


def _forward(rays: PlaneRays, rule: RayRule, volume: Tensor) -> Tensor:
    """Return the values of a rule; of "any" the light that passes, Π (1 - p)."""
    if volume.is_cuda:
        return gpu_kernels("ray_rules", volume).forward(rays, rule, volume)
    depth = (rays.samples,) if rule == "samples" else ()
    values = volume.new_empty(len(volume), rays.size, *depth, volume.shape[2])
    _run("forward", rays, rule, volume=volume, values=values)
    return values


def _back(rays: PlaneRays, rule: RayRule, of: Tensor, volume: Tensor | None, passed: Tensor | None) -> Tensor:
    """Return the gradient (B, X, Y, Z) of ⟨values, of⟩."""
    if of.is_cuda:
        return gpu_kernels("ray_rules", of).back(rays, rule, of, volume, passed)
    x, z = rays.plane
    gradient = of.new_empty(len(of), x, z, of.shape[-1])
    volume = gradient.transpose(2, 3) if volume is None else volume
    _run("back", rays, rule, volume=volume, values=of, gradient=gradient, passed=passed)
    return gradient.transpose(2, 3)


def _slope(rays: PlaneRays, rule: RayRule, volume: Tensor, of: Tensor, passed: Tensor | None) -> Tensor:
    """Return the gradient (B,) of ⟨values, of⟩ by the azimuth."""
    if volume.is_cuda:
        return gpu_kernels("ray_rules", volume).slope(rays, rule, volume, of, passed)
    gradient = of.new_empty(len(of))
    _run("slope", rays, rule, volume=volume, values=of, gradient=gradient, passed=passed)
    return gradient


def _run(task: str, rays: PlaneRays, rule: RayRule, volume: Tensor, values: Tensor, **rest: Tensor | None) -> None:
    """Run the kernel, the batch divided between torch's threads. Volumes and values may have any strides."""
    volume, azimuth = volume.detach(), rays.azimuth.detach()
    places = (*cos_sin(azimuth), rays.viewport, 0.0 if rays.offset is None else rays.offset)
    per_item = (torch.as_tensor(place, dtype=azimuth.dtype).expand(len(azimuth)).contiguous() for place in places)
    tensors = {"volume": volume, "values": values} | rest | dict(zip(TENSORS[4:], per_item, strict=True))
    counts = (*volume.shape[1:], rays.size, rays.samples, *volume.stride())
    strides = values.stride() if values.dim() == 4 else (*values.stride()[:2], 0, values.stride(2))
    numbers = dict(zip((*COUNTS[1:], *STRIDES), (*counts, *strides), strict=True))
    numbers |= dict(zip(LENGTHS, (rays.half_depth, *rays.extent), strict=True))
    call = _kernel(rule, task, volume)

    def part(start: int, end: int) -> None:
        given = {name: tensor[start:end].data_ptr() for name, tensor in tensors.items() if tensor is not None}
        call(ctypes.byref(Job(batch=end - start, **given, **numbers)))

    divided(len(volume), part)
