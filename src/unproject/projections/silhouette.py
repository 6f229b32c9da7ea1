"""Silhouettes of volumes, and the ways of looking that the experiments use.

A camera at (azimuth, elevation) sends a ray through each pixel; the volume is sampled along it by trilinear
interpolation and an occupancy rule (`ops.occupancy`) says how much of the ray is stopped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError
from ..ops.azimuth import PlaneRays, ray_samples, ray_sums, resample_heights
from ..ops.occupancy import absorption, any_occupied, capped_sum
from ..ops.resampling import (
    depth_range,
    orthographic_rays,
    perspective_rays,
    perspective_slant,
    sample_volume,
)
from ..ops.rotation import camera_frame
from .base import Projection
from .observation import Observation
from .priors import TURN, Bins, Mixture, Prior, Product, Uniform

RULES = ("any", "alpha", "absorption")
CAMERAS = ("orthographic", "perspective")


@dataclass(frozen=True)
class Silhouette(Projection):
    """y = rule(x sampled along the ray of each pixel): (B, X, Y, Z) → (B, 1, size, size), values in [0, 1].

    Attributes:
        size: pixels a side; the volume's resolution unless given.
        rule: "any" 1 - Π(1 - p), "alpha" the released capped sum, or "absorption" 1 - exp(-density ∫p).
        camera: "orthographic", or "perspective": a pinhole at `distance`.
        viewport: half the width seen in the plane through the centre; 1 is the object's box, 1.4 the released code's.
        depth_samples: samples a ray; one a voxel unless given. "any" and "alpha" depend on it, "absorption" does not.
        density: of "absorption": one full voxel, whatever the resolution, stops 1 - exp(-density).
        distance: of the pinhole from the object's centre; the field of view is 2 atan(viewport / distance).
        fast: take the level orthographic fast path (`ops.azimuth`) where it applies: same values, 8 to 25 times sooner.

    Raises:
        UserError: for an unknown rule or camera, or a pinhole inside the sampled depth of ±1.5.
    """

    size: int | None = None
    rule: str = "any"
    camera: str = "orthographic"
    viewport: float = 1.0
    depth_samples: int | None = None
    density: float = 1.0
    distance: float = 4.0
    fast: bool = True

    def __post_init__(self) -> None:
        _check(self.rule in RULES, f"unknown rule {self.rule!r}; choose one of {', '.join(RULES)}")
        _check(self.camera in CAMERAS, f"unknown camera {self.camera!r}; choose one of {', '.join(CAMERAS)}")
        _check(self.viewport > 0 and self.density > 0, "viewport and density must be positive")
        _check(self.camera == "orthographic" or self.distance > 2, "a perspective camera needs a distance above 2")
        counts = [n for n in (self.size, self.depth_samples) if n is not None]
        _check(all(n >= 1 for n in counts), "size and depth_samples must be at least 1")

    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, x: Tensor, *, azimuth: Tensor, elevation: Tensor | None = None
    ) -> Tensor:
        """The silhouettes of x (B, X, Y, Z) seen from azimuth (B,) and elevation (B,), radians."""
        _check(x.dim() == 4, f"a volume has the shape (B, X, Y, Z), not {tuple(x.shape)}")
        _check(azimuth.shape == x.shape[:1], f"give one azimuth a volume: ({len(x)},), not {tuple(azimuth.shape)}")
        with torch.autocast(x.device.type, enabled=False):
            # Half precision cannot place 64 samples along a ray.
            x = x if x.dtype == torch.float64 else x.float()
            azimuth = azimuth.to(x)
            elevation = torch.zeros_like(azimuth) if elevation is None else elevation.to(x)
            _check(elevation.shape == azimuth.shape, f"give one elevation a volume, not {tuple(elevation.shape)}")
            look = self._look_level if self._is_level(azimuth, elevation) else self._look
            return look(x, azimuth, elevation)

    @property
    def field_of_view(self) -> float:
        """The full angle (radians) that a perspective camera sees."""
        return 2 * math.atan(self.viewport / self.distance)

    def _is_level(self, azimuth: Tensor, elevation: Tensor) -> bool:
        fixed = not (azimuth.requires_grad or elevation.requires_grad)
        return self.fast and self.camera == "orthographic" and fixed and not bool(elevation.any())

    def _sampling(self, x: Tensor) -> tuple[int, float, int, float]:
        resolution = max(x.shape[1:])
        return self.size or resolution, self.viewport, *depth_range(resolution, self.depth_samples)

    def _look(self, x: Tensor, azimuth: Tensor, elevation: Tensor) -> Tensor:
        """The plain reference: trilinear samples along every ray."""
        frame, sampling, density = camera_frame(azimuth, elevation), self._sampling(x), self._density(x)
        if self.camera == "perspective":
            points = perspective_rays(frame, *sampling, self.distance)
            density = density * perspective_slant(x, *sampling[:2], self.distance)
        else:
            points = orthographic_rays(frame, *sampling)
        p = sample_volume(x, points)
        y = absorption(p, -1, density) if self.rule == "absorption" else _RULE[self.rule](p, -1)
        return y.unsqueeze(1)

    def _look_level(self, x: Tensor, azimuth: Tensor, _: Tensor) -> Tensor:
        """The same values when the elevation is 0."""
        size, viewport, samples, half_depth = self._sampling(x)
        rays = PlaneRays(azimuth, (x.shape[1], x.shape[3]), size, viewport, samples, half_depth)
        density = self._density(x)
        x = resample_heights(x, size, viewport)
        if self.rule == "absorption":
            columns = absorption(ray_sums(x, rays).unsqueeze(-1), -1, density)
        else:
            columns = _RULE[self.rule](ray_samples(x, rays), 2)
        return columns.transpose(1, 2).flip(1).unsqueeze(1)

    def _density(self, x: Tensor) -> float:
        """The density a sample, from the density a voxel."""
        resolution = max(x.shape[1:])
        samples, half_depth = depth_range(resolution, self.depth_samples)
        return self.density * half_depth * resolution / samples


_RULE = {"any": any_occupied, "alpha": capped_sum}


def azimuth_bins(count: int = 16, silhouette: Silhouette | None = None) -> tuple[Observation, ...]:
    """`count` bins of azimuth at elevation 0, the first centred on azimuth 0; uniform inside each."""
    return tuple(
        Observation(f"azimuth-{k:02d}", silhouette or Silhouette(), Product(azimuth, _level()))
        for k, azimuth in enumerate(Bins("azimuth", count).parts)
    )


def azimuth_elevation_bins(
    azimuths: int = 8, elevations: int = 3, silhouette: Silhouette | None = None
) -> tuple[Observation, ...]:
    """The released second set: azimuth bins times bands of elevation 15° wide, centred on the horizon."""
    bands = [math.radians(15) * (band - elevations / 2) for band in range(elevations + 1)]
    return tuple(
        Observation(
            f"azimuth-{k:02d}-elevation-{band}",
            silhouette or Silhouette(),
            Product(azimuth, Uniform("elevation", bands[band], bands[band + 1])),
        )
        for k, azimuth in enumerate(Bins("azimuth", azimuths).parts)
        for band in range(elevations)
    )


def continuous_views(
    silhouette: Silhouette | None = None, elevation: tuple[float, float] = (0.0, 0.0)
) -> tuple[Observation, ...]:
    """One way of looking: from anywhere around, at an elevation (radians) uniform in the given range."""
    prior = Product(Uniform("azimuth", 0, TURN, TURN), Uniform("elevation", *elevation))
    return (Observation("around", silhouette or Silhouette(), prior),)


def prgan_views(azimuths: int = 8, top: bool = True, silhouette: Silhouette | None = None) -> tuple[Observation, ...]:
    """PrGAN's one way of looking: one of `azimuths` exact azimuths, or from the top; all equally likely."""
    parts: list[Prior] = [_exactly(k * TURN / azimuths, 0) for k in range(azimuths)]
    parts += [_exactly(0, math.pi / 2)] if top else []
    return (Observation("prgan", silhouette or Silhouette(rule="absorption"), Mixture(parts)),)


def _exactly(azimuth: float, elevation: float) -> Product:
    return Product(Uniform("azimuth", azimuth, azimuth), Uniform("elevation", elevation, elevation))


def _level() -> Uniform:
    return Uniform("elevation", 0, 0)


def _check(holds: bool, message: str) -> None:
    if not holds:
        raise UserError(f"Silhouette: {message}")
