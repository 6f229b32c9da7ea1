"""Projections: forward operators, priors over their latents, and observations, which pair the two."""

from .base import Identity, Projection
from .line_integral import LineIntegral, directions
from .observation import Observation
from .priors import Bins, Cap, Empirical, Mixture, Prior, Product, Uniform
from .rendering import Rendering, rendering_prior
from .selection import Selection
from .silhouette import Silhouette, azimuth_bins, azimuth_elevation_bins
from .standardised import Standardised, standardised

__all__ = [
    "Bins",
    "Cap",
    "Empirical",
    "Identity",
    "LineIntegral",
    "Mixture",
    "Observation",
    "Prior",
    "Product",
    "Projection",
    "Rendering",
    "Selection",
    "Silhouette",
    "Standardised",
    "Uniform",
    "azimuth_bins",
    "azimuth_elevation_bins",
    "directions",
    "rendering_prior",
    "standardised",
]
