"""Projections: forward operators, priors over their latents, and observations, which pair the two."""

from .base import Identity, Projection
from .cropped import Cropped
from .framed import FramedSilhouette
from .line_integral import LineIntegral, directions
from .observation import Observation
from .priors import Bins, Cap, Empirical, Mixture, Prior, Product, Uniform
from .rendering import Rendering, rendering_prior
from .selection import Selection
from .silhouette import Silhouette, azimuth_bins, azimuth_elevation_bins, mirrored_views
from .standardised import Standardised, standardised

__all__ = [
    "Bins",
    "Cap",
    "Empirical",
    "Cropped",
    "FramedSilhouette",
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
    "mirrored_views",
    "rendering_prior",
    "standardised",
]
