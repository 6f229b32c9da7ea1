"""Scores with protocols: of sets of shapes, images, silhouettes, lines and materials, and of views up to gauge."""

from .confusion import confusion_picture
from .digit_classifier import are_digits
from .distances import chamfer, exposed_faces, one_minus_iou, surface_points
from .feature_sets import cubic_kernel, density_coverage, frechet_distance, kernel_distance, precision_recall
from .finding import WORDS, Finding, Word, worst
from .gauge import Gauge, apply, apply_to_images, best_gauge, dihedral
from .image_scores import best_image_gauge, image_scores, pixel_scores
from .line_sets import line_scores
from .map_correlation import CorrelationError, CorrelationTable, correlation_error, map_correlations
from .material_scores import material_scores
from .open_turns import open_gauges, randomly_turned, turned_scores
from .patches import PatchDistance, kernel_patches, patch_distance, texture_features
from .picture_sets import picture_scores
from .score import Score
from .shape_scores import set_scores, shape_scores
from .shape_sets import coverage, minimum_matching_distance, one_nearest_neighbour_accuracy
from .silhouette_sets import silhouette_features, silhouette_scores
from .views import ViewAccuracy, chance_level, of_ceiling, view_accuracy, view_scores

__all__ = [
    "WORDS",
    "CorrelationError",
    "CorrelationTable",
    "Finding",
    "Gauge",
    "PatchDistance",
    "Score",
    "ViewAccuracy",
    "Word",
    "apply",
    "apply_to_images",
    "are_digits",
    "best_gauge",
    "best_image_gauge",
    "chamfer",
    "chance_level",
    "confusion_picture",
    "correlation_error",
    "coverage",
    "cubic_kernel",
    "density_coverage",
    "dihedral",
    "exposed_faces",
    "frechet_distance",
    "image_scores",
    "kernel_distance",
    "kernel_patches",
    "line_scores",
    "map_correlations",
    "material_scores",
    "minimum_matching_distance",
    "of_ceiling",
    "open_gauges",
    "one_minus_iou",
    "one_nearest_neighbour_accuracy",
    "patch_distance",
    "precision_recall",
    "set_scores",
    "shape_scores",
    "silhouette_features",
    "picture_scores",
    "pixel_scores",
    "silhouette_scores",
    "surface_points",
    "texture_features",
    "randomly_turned",
    "turned_scores",
    "view_accuracy",
    "view_scores",
    "worst",
]
