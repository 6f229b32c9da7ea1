"""The reflection of a rough surface: Cook and Torrance's microfacets under a diffuse base (the paper's eq. 2).

    f(ωi, ωo) = k_d/π + k_s/4 D(h, m) G(ωi) G(ωo) F(h, η) / (cosθi cosθo),      h = (ωi + ωo) / |ωi + ωo|

Directions are unit vectors (..., 3) in the frame of the shading normal, z along it. `m` is the root mean square slope.

References:
    Cook and Torrance 1982; Walter et al. 2007, eq. 27 (the rational fit of Smith's shadowing); Schlick 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from .._types import UserError

TINY = 1e-6
LEAST_ROUGHNESS = 1e-3  # maps below it are shaded as if they had it
BRIGHT = 0.04  # F0 of a dielectric of η = 1.5: F90 falls to 0 with a lower F0


def beckmann(tan2: Tensor, m: Tensor) -> Tensor:
    """Compute D = exp(-tan²θh / m²) / (π m² cos⁴θh) of tan²θh; ∫ D cosθh dωh = 1."""
    tan2 = tan2.clamp(max=1e8)
    return torch.exp(-tan2 / m.square()) * (1 + tan2).square() / (math.pi * m.square())


def smith_over_cos(cos: Tensor, m: Tensor) -> Tensor:
    """Compute Smith's G1 / cosθ, which is 3.535/m at grazing angles. G1 is 1 for a = 1 / (m tanθ) of 1.6 or more."""
    cos = cos.clamp(min=TINY)
    slope = m * (1 - cos.square()).clamp(min=TINY**2).sqrt()  # m sinθ
    a = cos / slope
    fit = (3.535 + 2.181 * a) / (slope * (1 + 2.276 * a + 2.577 * a.square()))
    return torch.where(a < 1.6, fit, 1 / cos)


def cook_torrance_over_cos(cos_i: Tensor, cos_o: Tensor, cos_h: Tensor, o_h: Tensor) -> Tensor:
    """Compute min(1, 2 cosθh cosθo / (ωo·h), 2 cosθh cosθi / (ωo·h)) / (cosθi cosθo), of V-shaped grooves."""
    cos_i, cos_o, o_h = cos_i.clamp(min=TINY), cos_o.clamp(min=TINY), o_h.clamp(min=TINY)
    groove = 2 * cos_h / o_h
    return torch.minimum(torch.minimum(1 / (cos_i * cos_o), groove / cos_i), groove / cos_o)


def schlick(cos: Tensor, f0: Tensor | float, f90: Tensor | float = 1.0) -> Tensor:
    """Compute F = F0 + (F90 - F0) (1 - cosθ)⁵.

    Examples:
        >>> import torch
        >>> schlick(torch.tensor([1.0, 0.0]), f0=0.04)
        tensor([0.0400, 1.0000])
    """
    return f0 + (f90 - f0) * (1 - cos).clamp(0, 1) ** 5


def reflectance(eta: float) -> float:
    """Compute F0 = ((η - 1) / (η + 1))², at normal incidence on a dielectric."""
    return ((eta - 1) / (eta + 1)) ** 2


@dataclass(frozen=True)
class Reflection:
    """The reflection model: the meaning of the specular albedo, and the shadowing term.

    Attributes:
        fresnel: "eta", the paper's: F0 comes from η and k_s scales the lobe; energy is conserved if k_d + k_s ≤ 1.
            "albedo", the convention of artists: F0 = k_s, and the base has the albedo k_d (1 - F(cosθo)), so that
            energy is conserved to half a per cent: the lobe has the mean of F over its facets. F90 is proportional to
            k_s below 0.04, so that k_s = 0 means no lobe.
        eta: the index of refraction of "eta".
        shadowing: "smith", separable, or "cook-torrance".

    Raises:
        UserError: for an unknown setting, or an index of refraction that is not positive.

    Examples:
        >>> import unproject as up
        >>> artists = up.ops.microfacet.Reflection("albedo")
        >>> up.Rendering("ambient", artists).reflection.fresnel
        'albedo'
    """

    fresnel: Literal["eta", "albedo"] = "eta"
    eta: float = 1.5
    shadowing: Literal["smith", "cook-torrance"] = "smith"

    def __post_init__(self) -> None:
        if self.fresnel not in ("eta", "albedo"):
            raise UserError(f"fresnel {self.fresnel!r}: give 'eta' (F0 from the index η) or 'albedo' (F0 = specular)")
        if self.shadowing not in ("smith", "cook-torrance"):
            raise UserError(f"shadowing {self.shadowing!r}: give 'smith' or 'cook-torrance'")
        if not (math.isfinite(self.eta) and self.eta > 0):
            raise UserError(f"eta {self.eta:g}: give a positive index of refraction, 1.5 for glass, wood and plastic")

    def terms(self, k_s: Tensor) -> tuple[Tensor | float, Tensor | float, Tensor | float]:
        """Return the scale of the lobe, F0 and F90."""
        if self.fresnel == "eta":
            return k_s, reflectance(self.eta), 1.0
        return 1.0, k_s, (k_s / BRIGHT).clamp(max=1)

    def base(self, k_d: Tensor, k_s: Tensor, cos_o: Tensor) -> Tensor:
        """Return the albedo of the diffuse base: k_d, less the specular reflection with "albedo"; all are broadcast."""
        if self.fresnel == "eta":
            return k_d
        _, f0, f90 = self.terms(k_s)
        return k_d * (1 - schlick(cos_o.abs(), f0, f90)).clamp(min=0)

    def lobe(self, k_s: Tensor, m: Tensor, i: Tensor, o: Tensor) -> Tensor:
        """Return the specular part of f times cosθi; 0 where either direction is below the surface."""
        h, o_h = half_vector(i, o)
        return self.lobe_of(k_s, m, i[..., 2], o[..., 2], h[..., 2], tan_squared(h), o_h)

    def lobe_of(
        self, k_s: Tensor, m: Tensor, cos_i: Tensor, cos_o: Tensor, cos_h: Tensor, tan2: Tensor, o_h: Tensor
    ) -> Tensor:
        """Return the same of cosθi, cosθo, cosθh, tan²θh and ωo·h; all are broadcast to one shape."""
        scale, f0, f90 = self.terms(k_s)
        if self.shadowing == "smith":
            seen = smith_over_cos(cos_i, m) * smith_over_cos(cos_o, m)
        else:
            seen = cook_torrance_over_cos(cos_i, cos_o, cos_h, o_h)
        value = scale / 4 * beckmann(tan2, m) * seen * schlick(o_h, f0, f90) * cos_i.clamp(min=0)
        return torch.where((cos_i > 0) & (cos_o > TINY), value, torch.zeros_like(value))


def half_vector(i: Tensor, o: Tensor) -> tuple[Tensor, Tensor]:
    """Return h and ωo·h."""
    h = i + o
    h = h / h.square().sum(-1, keepdim=True).clamp(min=TINY**2).sqrt()
    return h, (o * h).sum(-1)


def tan_squared(h: Tensor) -> Tensor:
    """Return tan²θ of vectors (..., 3), from x and y: 1 - cos² loses all digits where m is small."""
    return h[..., :2].square().sum(-1) / h[..., 2].square().clamp(min=TINY**2)


def sample_cosine(u: Tensor, v: Tensor) -> Tensor:
    """Draw directions with density cosθ/π from u and v in [0, 1): θ from u, the azimuth from v."""
    return _direction(u.sqrt(), (1 - u).sqrt(), v)


def sample_beckmann(u: Tensor, v: Tensor, m: Tensor) -> Tensor:
    """Draw half vectors with density D cosθh: tan²θh = -m² log(1 - u)."""
    tan2 = -m.square() * torch.log1p(-u.clamp(TINY, 1 - TINY))
    cos = (1 + tan2).rsqrt()
    return _direction(tan2.sqrt() * cos, cos, v)


def _direction(sin: Tensor, cos: Tensor, v: Tensor) -> Tensor:
    azimuth = 2 * math.pi * v
    return torch.stack(torch.broadcast_tensors(sin * azimuth.cos(), sin * azimuth.sin(), cos), -1)


def reflect(o: Tensor, h: Tensor) -> Tensor:
    """Return o reflected about h."""
    return 2 * (o * h).sum(-1, keepdim=True) * h - o


def cosine_density(i: Tensor) -> Tensor:
    """Return the density, by solid angle, of directions drawn by `sample_cosine`."""
    return i[..., 2].clamp(min=0) / math.pi


def lobe_density(i: Tensor, o: Tensor, m: Tensor) -> Tensor:
    """Return the density of o reflected about half vectors drawn by `sample_beckmann`: D cosθh / (4 ωo·h)."""
    h, o_h = half_vector(i, o)
    value = beckmann(tan_squared(h), m) * h[..., 2].clamp(min=0) / (4 * o_h.clamp(min=TINY))
    return torch.where((i[..., 2] > 0) & (o[..., 2] > TINY), value, torch.zeros_like(value))
