"""The rules of `ray_rules` on a GPU, in Triton, which PyTorch brings along there.

Kernels work on one ray, or one column of voxels, at a block of heights: volumes are copied once so that heights lie
side by side. Nothing is added to by several programs at a time: the gradient of a column gathers from the samples
within one voxel of it, so that equal inputs give equal bits. The names are those of `ray_rules.cpp`.
"""

# pyright: reportMissingImports=false, reportIndexIssue=false, reportArgumentType=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportGeneralTypeIssues=false

from __future__ import annotations

from functools import cache
from typing import Any

import torch
import triton
import triton.language as tl
from torch import Tensor

from .azimuth import PlaneRays
from .rotation import cos_sin

SAMPLES, SUM, ANY, ALPHA = (tl.constexpr(number) for number in range(4))
RULES = {"samples": 0, "sum": 1, "any": 2, "alpha": 3}
MOST_HEIGHTS = 128
"""Heights of a program at most."""
REST = tl.constexpr(1e-6 - 1)
FULL = tl.constexpr(1 + 1e-4)


@triton.jit
def _origin(turn, place, step: tl.constexpr, lengths, b, batch):
    """Of item b: cos and sin of its azimuth, viewport, offset, and half the depth and the sides of the plane."""
    second = place + (batch if step else 1) + b * step
    return (
        tl.load(turn + b), tl.load(turn + batch + b), tl.load(place + b * step), tl.load(second),
        tl.load(lengths), tl.load(lengths + 1), tl.load(lengths + 2),
    )  # fmt: skip


@triton.jit
def _across(pixel, size, viewport, offset):
    """The place of a pixel across the picture."""
    return viewport * ((2 * pixel + 1 - size).to(viewport.dtype) / size) + offset


@triton.jit
def _depth(k, samples, half_depth):
    """The depth of a sample, towards the camera."""
    return -half_depth * ((2 * k + 1 - samples).to(half_depth.dtype) / samples)


@triton.jit
def _index(along, half, count):
    """The fractional index of a place in [-half, half]."""
    return ((along / half + 1) * count - 1) / 2


@triton.jit
def _corners(volume, b, px, pz, X, Z, Y, y, valid):
    """The values at the four places around a sample, 0 outside of the volume, and its place between them."""
    ix, iz = tl.floor(px), tl.floor(pz)
    i, k = ix.to(tl.int32), iz.to(tl.int32)
    row = volume + ((b * X + i) * Z + k).to(tl.int64) * Y + y
    left, right, near, far = (i >= 0) & (i < X), i + 1 < X, (k >= 0) & (k < Z), k + 1 < Z
    va = tl.load(row, valid & (left & near), 0)
    vb = tl.load(row + Y, valid & (left & far), 0)
    vc = tl.load(row + Z * Y, valid & (right & near), 0)
    vd = tl.load(row + Z * Y + Y, valid & (right & far), 0)
    return va, vb, vc, vd, px - ix, pz - iz


@triton.jit
def _forward(volume, turn, place, lengths, values, batch, X, Y, Z, size, samples, step: tl.constexpr,
             RULE: tl.constexpr, BLOCK: tl.constexpr):  # fmt: skip
    """Values (B, size, Y), or samples (B, size, samples, Y); of "any" the light that passes."""
    ray, y = tl.program_id(0), tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    b, pixel, valid = ray // size, ray % size, y < Y
    c, s, viewport, offset, half_depth, half_width, half_length = _origin(turn, place, step, lengths, b, batch)
    u = _across(pixel, size, viewport, offset)
    sound = (tl.abs(u * c) < float("inf")) & (tl.abs(u * s) < float("inf"))
    total = tl.zeros([BLOCK], c.dtype)
    if RULE == ANY:
        total += 1
    running = tl.zeros([BLOCK], c.dtype)
    for k in range(samples):
        w = _depth(k, samples, half_depth)
        px, pz = _index(u * c + w * s, half_width, X), _index(w * c - u * s, half_length, Z)
        q = tl.zeros([BLOCK], c.dtype)
        if (px > -1) & (px < X) & (pz > -1) & (pz < Z):
            va, vb, vc, vd, fx, fz = _corners(volume, b, px, pz, X, Z, Y, y, valid)
            q = (1 - fx) * ((1 - fz) * va + fz * vb) + fx * ((1 - fz) * vc + fz * vd)
        if RULE == SAMPLES:
            tl.store(values + (ray.to(tl.int64) * samples + k) * Y + y, tl.where(sound, q, float("nan")), valid)
        if RULE == SUM:
            total += q
        if RULE == ANY:
            total *= 1 + q * REST
        if RULE == ALPHA:
            running += q
            total += tl.where(running <= FULL, q, 0)
    if RULE != SAMPLES:
        tl.store(values + ray.to(tl.int64) * Y + y, tl.where(sound, total, float("nan")), valid)


@triton.jit
def _pull(volume, of, passed, turn, place, lengths, pulled, batch, X, Y, Z, size, samples, step: tl.constexpr,
          RULE: tl.constexpr, BLOCK: tl.constexpr):  # fmt: skip
    """The derivatives of ⟨values, of⟩ by the samples, (B, size, samples, Y), of "any" and "alpha"."""
    ray, y = tl.program_id(0), tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    b, pixel, valid = ray // size, ray % size, y < Y
    c, s, viewport, offset, half_depth, half_width, half_length = _origin(turn, place, step, lengths, b, batch)
    u = _across(pixel, size, viewport, offset)
    g = tl.load(of + ray.to(tl.int64) * Y + y, valid, 0)
    light = tl.zeros([BLOCK], c.dtype)
    if RULE == ANY:
        light += tl.load(passed + ray.to(tl.int64) * Y + y, valid, 0)
    running = tl.zeros([BLOCK], c.dtype)
    for k in range(samples):
        w = _depth(k, samples, half_depth)
        px, pz = _index(u * c + w * s, half_width, X), _index(w * c - u * s, half_length, Z)
        q = tl.zeros([BLOCK], c.dtype)
        if (px > -1) & (px < X) & (pz > -1) & (pz < Z):
            va, vb, vc, vd, fx, fz = _corners(volume, b, px, pz, X, Z, Y, y, valid)
            q = (1 - fx) * ((1 - fz) * va + fz * vb) + fx * ((1 - fz) * vc + fz * vd)
        running += q
        d = tl.where(running <= FULL, g, 0)
        if RULE == ANY:
            d = -g * light * REST / (1 + q * REST)
        # Outside of the volume too: another kernel may round a place on its border to within.
        tl.store(pulled + (ray.to(tl.int64) * samples + k) * Y + y, d, valid)


@triton.jit
def _gather(of, turn, place, lengths, gradient, batch, X, Y, Z, size, samples, step: tl.constexpr,
            SUMMED: tl.constexpr, BLOCK: tl.constexpr):  # fmt: skip
    """The gradient (B, X, Z, Y) by a column of voxels, from what is asked of samples, or, if SUMMED, of their sums."""
    column, y = tl.program_id(0), tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    b, ix, iz, valid = column // (X * Z), column // Z % X, column % Z, y < Y
    c, s, viewport, offset, half_depth, half_width, half_length = _origin(turn, place, step, lengths, b, batch)
    dx, dz = 2 * half_width / X, 2 * half_length / Z
    x, z = (ix + 0.5) * dx - half_width, (iz + 0.5) * dz - half_length
    u, w = x * c - z * s - offset, x * s + z * c
    reach_u, reach_w = tl.abs(c) * dx + tl.abs(s) * dz, tl.abs(s) * dx + tl.abs(c) * dz
    # Indices of pixels and samples around the column; a little more, as positions are rounded.
    middle, reach = _index(u, viewport, size), reach_u / viewport * size / 2 + 1e-3
    middle_w, reach_w = _index(-w, half_depth, samples), reach_w / half_depth * samples / 2 + 1e-3
    sound = tl.abs(middle) + reach + tl.abs(middle_w) + reach_w < float("inf")
    middle, middle_w = tl.where(sound, middle, -9.0), tl.where(sound, middle_w, -9.0)
    reach, reach_w = tl.where(sound, reach, 0.0), tl.where(sound, reach_w, 0.0)
    first = tl.ceil(tl.minimum(tl.maximum(middle - reach, 0.0), size)).to(tl.int32)
    last = tl.floor(tl.minimum(tl.maximum(middle + reach, -1.0), size - 1)).to(tl.int32)
    nearest = tl.ceil(tl.minimum(tl.maximum(middle_w - reach_w, 0.0), samples)).to(tl.int32)
    farthest = tl.floor(tl.minimum(tl.maximum(middle_w + reach_w, -1.0), samples - 1)).to(tl.int32)
    total = tl.zeros([BLOCK], c.dtype)
    for pixel in range(first, last + 1):
        across, ray = _across(pixel, size, viewport, offset), (b * size + pixel).to(tl.int64)
        share = across * 0
        for k in range(nearest, farthest + 1):
            depth = _depth(k, samples, half_depth)
            px = _index(across * c + depth * s, half_width, X)
            pz = _index(depth * c - across * s, half_length, Z)
            weight = tl.maximum(1 - tl.abs(px - ix), 0.0) * tl.maximum(1 - tl.abs(pz - iz), 0.0)
            if SUMMED:
                share += weight
            elif weight > 0:
                total += weight * tl.load(of + (ray * samples + k) * Y + y, valid, 0)
        if SUMMED:
            total += share * tl.load(of + ray * Y + y, valid, 0)
    tl.store(gradient + column.to(tl.int64) * Y + y, total, valid)


@triton.jit
def _slope(volume, of, turn, place, lengths, slopes, batch, X, Y, Z, size, samples, step: tl.constexpr,
           SUMMED: tl.constexpr, BLOCK: tl.constexpr):  # fmt: skip
    """The part (B, size, blocks) of each ray in the derivative by the azimuth, of samples or, if SUMMED, their sums."""
    ray, y = tl.program_id(0), tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    b, pixel, valid = ray // size, ray % size, y < Y
    c, s, viewport, offset, half_depth, half_width, half_length = _origin(turn, place, step, lengths, b, batch)
    u = _across(pixel, size, viewport, offset)
    total = tl.zeros([BLOCK], c.dtype)
    for k in range(samples):
        w = _depth(k, samples, half_depth)
        px, pz = _index(u * c + w * s, half_width, X), _index(w * c - u * s, half_length, Z)
        if (px > -1) & (px < X) & (pz > -1) & (pz < Z):
            va, vb, vc, vd, fx, fz = _corners(volume, b, px, pz, X, Z, Y, y, valid)
            along_x = (vc - va) * (1 - fz) + (vd - vb) * fz
            along_z = (vb - va) * (1 - fx) + (vd - vc) * fx
            by_x = (w * c - u * s) / half_width * X / 2
            by_z = -(u * c + w * s) / half_length * Z / 2
            place_of = ray.to(tl.int64) if SUMMED else ray.to(tl.int64) * samples + k
            total += tl.load(of + place_of * Y + y, valid, 0) * (along_x * by_x + along_z * by_z)
    tl.store(slopes + ray * tl.num_programs(1) + tl.program_id(1), tl.sum(total, 0))


class _Rays:
    """Rays and the sizes of what they meet, as the kernels take them."""

    def __init__(self, rays: PlaneRays, heights: int) -> None:
        azimuth = rays.azimuth.detach()
        self.rays, self.batch, self.heights = rays, len(azimuth), heights
        self.turn = torch.stack(cos_sin(azimuth))
        self.place, self.step = _places(rays, azimuth)
        self.lengths = _row((rays.half_depth, *rays.extent), azimuth.dtype, azimuth.device)
        self.block = min(MOST_HEIGHTS, triton.next_power_of_2(heights))
        self.warps = max(self.block // 32, 1)

    def run(self, kernel: Any, programs: int, *tensors: Tensor, of: Tensor, **constants: Any) -> Tensor:
        """Run `programs` times the blocks of heights; `of` is written."""
        rays, (x, z) = self.rays, self.rays.plane
        sizes = self.batch, x, self.heights, z, rays.size, rays.samples, self.step
        grid = programs, triton.cdiv(self.heights, self.block)
        if of.numel():
            with torch.cuda.device_of(of):
                given = *tensors, self.turn, self.place, self.lengths, of, *sizes
                kernel[grid](*given, **constants, BLOCK=self.block, num_warps=self.warps)
        return of


def forward(rays: PlaneRays, rule: str, volume: Tensor) -> Tensor:
    """Return the values of a rule; of "any" the light that passes, Π (1 - p)."""
    columns, places = _columns(volume), _Rays(rays, volume.shape[2])
    depth = (rays.samples,) if rule == "samples" else ()
    values = volume.new_empty(len(volume), rays.size, *depth, volume.shape[2])
    return places.run(_forward, len(volume) * rays.size, columns, of=values, RULE=RULES[rule])


def back(rays: PlaneRays, rule: str, of: Tensor, volume: Tensor | None, passed: Tensor | None) -> Tensor:
    """Return the gradient (B, X, Y, Z) of ⟨values, of⟩."""
    of, (x, z), places = of.contiguous(), rays.plane, _Rays(rays, of.shape[-1])
    if volume is not None:
        of = _pulled(places, rule, of, volume, passed)
    gradient = of.new_empty(len(of), x, z, of.shape[-1])
    places.run(_gather, len(of) * x * z, of, of=gradient, SUMMED=rule == "sum")
    return gradient.transpose(2, 3)


def slope(rays: PlaneRays, rule: str, volume: Tensor, of: Tensor, passed: Tensor | None) -> Tensor:
    """Return the gradient (B,) of ⟨values, of⟩ by the azimuth."""
    of, places = of.contiguous(), _Rays(rays, of.shape[-1])
    if rule in ("any", "alpha"):
        of = _pulled(places, rule, of, volume, passed)
    parts = of.new_empty(len(of), rays.size, triton.cdiv(places.heights, places.block))
    places.run(_slope, len(of) * rays.size, _columns(volume), of, of=parts, SUMMED=rule == "sum")
    return parts.sum((1, 2))


def _pulled(places: _Rays, rule: str, of: Tensor, volume: Tensor, passed: Tensor | None) -> Tensor:
    size, samples = places.rays.size, places.rays.samples
    pulled = of.new_empty(len(of), size, samples, of.shape[-1])
    light = of if passed is None else passed
    return places.run(_pull, len(of) * size, _columns(volume), of, light, of=pulled, RULE=RULES[rule])


def _columns(volume: Tensor) -> Tensor:
    """Return a volume as (B, X, Z, Y), heights side by side."""
    return volume.detach().transpose(2, 3).contiguous()


def _places(rays: PlaneRays, like: Tensor) -> tuple[Tensor, int]:
    """Return viewports and offsets, (2, B) or, of one for all, (2, 1), and how far those of two items are apart."""
    offset = 0.0 if rays.offset is None else rays.offset
    if not isinstance(rays.viewport, Tensor) and not isinstance(offset, Tensor):
        return _row((float(rays.viewport), offset), like.dtype, like.device), 0
    both = (torch.as_tensor(value, dtype=like.dtype, device=like.device) for value in (rays.viewport, offset))
    return torch.stack([value.detach().expand(len(like)) for value in both]), 1


@cache
def _row(values: tuple[float, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    return torch.tensor(values, dtype=dtype, device=device)
