"""Silhouettes of volumes, and the sets of views used in the experiments.

A camera at (azimuth, elevation) sends a ray through each pixel. The volume is sampled along the ray by trilinear
interpolation, and an occupancy rule (`ops.occupancy`) gives the pixel's value from the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, TypeAlias, get_args

import torch
from torch import Tensor

from .._types import UserError
from ..ops.azimuth import PlaneRays, resample_heights
from ..ops.elevation import side_slices, slice_values
from ..ops.occupancy import absorption, any_occupied, capped_sum
from ..ops.ray_rules import ray_values
from ..ops.resampling import (
    depth_range,
    orthographic_rays,
    perspective_rays,
    perspective_slant,
    pinhole_rays,
    ray_points,
    sample_volume,
)
from ..ops.straight_rays import straight_ray_sums
from .base import Projection
from .observation import Observation
from .priors import Bins, Product, Uniform
from .view import NEAREST, View, either, varies

Rule: TypeAlias = Literal["any", "alpha", "absorption"]
Camera: TypeAlias = Literal["orthographic", "perspective"]
RULES, CAMERAS = get_args(Rule), get_args(Camera)


class Window(NamedTuple):
    """What a camera sees of the plane through the centre: `viewport`, or (B,), to all sides of (right, up), (B,)."""

    viewport: float | Tensor
    right: Tensor | None = None
    up: Tensor | None = None


@dataclass(frozen=True)
class Silhouette(Projection):
    """y = rule(x sampled along the ray of each pixel): (B, X, Y, Z) → (B, 1, size, size), values in [0, 1].

    Attributes:
        size: pixels a side (default: the volume's resolution).
        rule: "any" is 1 - Π(1 - p), "alpha" the capped sum of the released code, "absorption" 1 - exp(-density ∫p).
        camera: "orthographic", or "perspective": a pinhole at `distance`.
        viewport: half the visible width of the plane through the centre; 1 is the object's box, the released code
            has 1.4.
        depth_samples: samples a ray (default: one a voxel). "any" and "alpha" depend on it, "absorption" does not.
        density: of "absorption": one full voxel absorbs 1 - exp(-density), at every resolution.
        distance: of the pinhole from the object's centre; the field of view is 2 atan(viewport / distance).
        fast: walk along whole columns of rays (`ops.ray_rules`): of orthographic cameras at elevation 0 with the same
            values, 7 to 32 times faster than the released algorithm on a CPU with a compiler (docs/results.md); of
            those at others (`ops.elevation`), where no gradient in the azimuth is asked for, at about three times the
            cost of level ones. These interpolate the volume in another order, so pixels differ from the reference: of
            chairs at 32³ by 0.003 to 0.007 in the mean for "any" and "absorption", 0.025 for "alpha" (which jumps), by
            up to 0.25 at a rim below 60°, and by more in 4 of 1000 pixels above. At elevation 0 they equal level views
            up to rounding. Cameras in perspective or rolled have the values of the reference: for "absorption" by
            `ops.straight_rays`, at one to three times the cost of level views on a CPU with a compiler; else the
            reference itself.

    Latents, (B,) each: `azimuth`, `elevation` and `roll` in radians, `perspective` as one over the distance of the
    pinhole from the object's centre, 0 (orthographic) to 0.45. Roll turns the picture about its centre,
    counter-clockwise. A prior may leave out `perspective` and `roll`. Those of the other pictures of a batch do not
    matter, but where a gradient in perspective or roll is asked for, all pictures have the values of the reference.

    Raises:
        UserError: for an unknown rule or camera, a pinhole inside the sampled depth of ±1.5, a volume or latent of
            another shape, a perspective outside of its range, or one for the fixed pinhole of camera="perspective".

    Examples:
        >>> import math, torch, unproject as up
        >>> cube = torch.zeros(1, 16, 16, 16)
        >>> cube[:, 4:12, 4:12, 4:12] = 1
        >>> masks = up.Silhouette()(cube.expand(2, -1, -1, -1), azimuth=torch.tensor([0.0, math.pi / 2]))
        >>> masks.shape
        torch.Size([2, 1, 16, 16])
        >>> round(masks[0].mean().item(), 2)  # the front face covers a quarter of the picture
        0.25
    """

    silhouettes: ClassVar[bool] = True
    size: int | None = None
    rule: Rule = "any"
    camera: Camera = "orthographic"
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

    @property
    def optional_latents(self) -> tuple[str, ...]:
        """The latents that a prior may leave out: the camera is then orthographic and upright."""
        return ("perspective", "roll")

    def forward(
        self,
        x: Tensor,
        *,
        azimuth: Tensor,
        elevation: Tensor | None = None,
        perspective: Tensor | None = None,
        roll: Tensor | None = None,
    ) -> Tensor:
        """Return the silhouettes (B, 1, size, size) of x (B, X, Y, Z); latents are (B,)."""
        return self.seen(x, self.view(x, azimuth, elevation, perspective, roll))

    def view(self, x: Tensor, *latents: Tensor | None) -> View:
        """Return azimuth, elevation, perspective and roll, 0 where they are None or left out, after checking them."""
        _check(x.dim() == 4, f"a volume has the shape (B, X, Y, Z), not {tuple(x.shape)}")
        kind = torch.float64 if x.dtype == torch.float64 else torch.float32
        given = [None if latent is None else latent.to(x.device, kind) for latent in latents]
        zeros = torch.zeros(len(x), dtype=kind, device=x.device)
        view = View(*(zeros if latent is None else latent for latent in (*given, *[None] * (4 - len(given)))))
        for name, latent in zip(View._fields, view, strict=True):
            shape = tuple(latent.shape)
            _check(shape == (len(x),), f"give one {name} a volume: ({len(x)},), not {shape}")
        inside = (view.perspective >= 0) & (view.perspective <= NEAREST)
        _check(bool(inside.all()), f"perspective is one over the pinhole's distance: give 0 to {NEAREST}")
        fixed = self.camera == "perspective" and varies(view.perspective)
        _check(not fixed, 'this pinhole has its `distance`; give perspective to camera="orthographic"')
        return view

    def seen(self, x: Tensor, view: View, window: Window | None = None) -> Tensor:
        """Return the silhouettes in a window of each picture (default: the viewport)."""
        with torch.autocast(x.device.type, enabled=False):
            # Half precision cannot place 64 samples along a ray.
            x = x.to(view.azimuth)
            if self.camera == "perspective" or not self.fast or view.azimuth.requires_grad:
                return self._project(x, view, window)
            if window is None:
                return either(view.upright(), self._project_upright, self._project_rays, x, view)
            level = bool(view.level().all())
            return self._project_level(x, view.azimuth, window) if level else self._project_rays(x, view, window)

    def _sampling(self, x: Tensor) -> tuple[int, float, int, float]:
        resolution = max(x.shape[1:])
        return self.size or resolution, self.viewport, *depth_range(resolution, self.depth_samples)

    def _project(self, x: Tensor, view: View, window: Window | None = None) -> Tensor:
        """Return the silhouettes by trilinear samples along every ray: the plain reference."""
        sampling, density = self._sampling(x), self._density(x)
        if self.camera == "perspective":
            points = perspective_rays(view.frame(), *sampling, self.distance)
            density = density * perspective_slant(x, *sampling[:2], self.distance)
        elif varies(view.perspective) or window is not None:
            origin, direction = self._rays(x, view, window)
            points, density = ray_points(origin, direction, *sampling[2:]), density * direction.norm(dim=-1)
        else:
            points = orthographic_rays(view.frame(), *sampling)
        p = sample_volume(x, points)
        y = absorption(p, -1, density) if self.rule == "absorption" else _RULE[self.rule](p, -1)
        # Samples at places that are NaN are 0, as outside of the volume.
        broken = ~torch.stack(view).isfinite().all(0)
        return y.masked_fill(broken[:, None, None], math.nan).unsqueeze(1)

    def _project_rays(self, x: Tensor, view: View, window: Window | None = None) -> Tensor:
        """Return the values of `_project`, without storing the samples where the rule needs nothing but their sum."""
        if self.rule != "absorption":
            return self._project(x, view, window)
        origin, direction = self._rays(x, view, window)
        sums = straight_ray_sums(x, origin, direction, *self._sampling(x)[2:])
        return absorption(sums.unsqueeze(-1), -1, self._density(x) * direction.norm(dim=-1)).unsqueeze(1)

    def _rays(self, x: Tensor, view: View, window: Window | None) -> tuple[Tensor, Tensor]:
        viewport, right, up = window or Window(self.viewport)
        size, middle = self._sampling(x)[0], (0.0 if place is None else place for place in (right, up))
        return pinhole_rays(view.frame(), size, viewport, view.perspective, *middle)

    def _project_upright(self, x: Tensor, view: View) -> Tensor:
        if not varies(view.elevation):
            return self._project_level(x, view.azimuth, Window(self.viewport))
        return self._project_tilted(x, view.azimuth, view.elevation)

    def _project_level(self, x: Tensor, azimuth: Tensor, window: Window) -> Tensor:
        """Return the values of `_project` at elevation 0."""
        size, _, samples, half_depth = self._sampling(x)
        plane = (x.shape[1], x.shape[3])
        rays = PlaneRays(azimuth, plane, size, window.viewport, samples, half_depth, offset=window.right)
        if self.rule == "absorption":  # sums of heights between cells are between the sums of cells
            sums = resample_heights(ray_values(x, rays, "sum").unsqueeze(3), size, window.viewport, window.up)
            columns = absorption(sums, 3, self._density(x))
        else:
            columns = ray_values(resample_heights(x, size, window.viewport, window.up), rays, self.rule)
        return columns.transpose(1, 2).flip(1).unsqueeze(1)

    def _project_tilted(self, x: Tensor, azimuth: Tensor, elevation: Tensor) -> Tensor:
        """Return nearly the values of `_project`, a few volumes at a time so that their slices stay in the cache."""
        size, *_ = self._sampling(x)
        most = _CACHED * 100 if x.is_cuda else _CACHED
        few = max(1, most // (size * self._depths(x) * x.shape[2]))
        chunks = zip(*(part.split(few) for part in (x, azimuth, elevation)))
        return torch.cat([self._project_few(*chunk) for chunk in chunks])

    def _project_few(self, x: Tensor, azimuth: Tensor, elevation: Tensor) -> Tensor:
        size, viewport, samples, half_depth = self._sampling(x)
        slices = side_slices(x, azimuth, size, viewport, self._depths(x), half_depth)
        rule = "sum" if self.rule == "absorption" else self.rule
        y = slice_values(slices, elevation, size, viewport, samples, half_depth, rule)
        y = absorption(y.unsqueeze(3), 3, self._density(x)) if rule == "sum" else y
        return y.flip(1, 2).unsqueeze(1)

    def _depths(self, x: Tensor) -> int:
        """Return an odd multiple of the samples, at least one a voxel: the samples of level rays are among them."""
        _, _, samples, _ = self._sampling(x)
        return samples * (math.ceil(depth_range(max(x.shape[1:]))[0] / samples) // 2 * 2 + 1)

    def _density(self, x: Tensor) -> float:
        """Return the density of a sample, from the density of a voxel."""
        resolution = max(x.shape[1:])
        samples, half_depth = depth_range(resolution, self.depth_samples)
        return self.density * half_depth * resolution / samples


_CACHED = 1_000_000
"""Values of slices at a time: as fast as one volume at a time for large volumes, as all of them for small ones. A GPU,
which is slow to begin anything, works on a hundred times as many."""

EDGE = 1e-6
"""Radians by which the last band of elevations is larger."""

_RULE = {"any": any_occupied, "alpha": capped_sum}


def azimuth_bins(count: int = 16, silhouette: Projection | None = None) -> tuple[Observation, ...]:
    """Return silhouettes in `count` bins of azimuth at elevation 0, the first centred on azimuth 0; uniform in each.

    Examples:
        >>> from unproject.projections import azimuth_bins
        >>> views = azimuth_bins(16)
        >>> len(views), views[0].name, views[0].prior.names
        (16, 'azimuth-00', ('azimuth', 'elevation'))
    """
    return tuple(
        Observation(f"azimuth-{k:02d}", silhouette or Silhouette(), Product(azimuth, _level()))
        for k, azimuth in enumerate(Bins("azimuth", count).parts)
    )


def azimuth_elevation_bins(
    azimuths: int = 8, elevations: int = 3, silhouette: Projection | None = None
) -> tuple[Observation, ...]:
    """Return silhouettes in bins of azimuth × bands of elevation, 15° wide, centred on 0: the released second set."""
    bands = [math.radians(15) * (band - elevations / 2) for band in range(elevations + 1)]
    bands[-1] += EDGE  # a bin does not contain its upper end, but the last one should
    return tuple(
        Observation(
            f"azimuth-{k:02d}-elevation-{band}",
            silhouette or Silhouette(),
            Product(azimuth, Uniform("elevation", bands[band], bands[band + 1])),
        )
        for k, azimuth in enumerate(Bins("azimuth", azimuths).parts)
        for band in range(elevations)
    )


def mirrored_views(azimuths: int, elevations: int = 1) -> tuple[int, ...]:
    """Return, for each of these bins, the one with the opposite azimuth: of `azimuth_bins`, or with bands of elevation.

    The silhouette of an object that is symmetric about the plane x = 0 from azimuth -a is its flipped silhouette from
    a, at any elevation.

    Examples:
        >>> import unproject as up
        >>> up.projections.mirrored_views(4)
        (0, 3, 2, 1)
    """
    return tuple(-k % azimuths * elevations + band for k in range(azimuths) for band in range(elevations))


def _level() -> Uniform:
    return Uniform("elevation", 0, 0)


def _check(holds: bool, message: str) -> None:
    if not holds:
        raise UserError(f"Silhouette: {message}")
