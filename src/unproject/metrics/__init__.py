"""Scores, each with its protocol: sets of shapes, of images and of views up to gauge, sets of silhouettes."""

from .confusion import confusion_picture
from .distances import chamfer, exposed_faces, one_minus_iou, surface_points
from .feature_sets import cubic_kernel, density_coverage, frechet_distance, kernel_distance, precision_recall
from .gauge import Gauge, apply, apply_to_images, best_gauge, dihedral
from .image_scores import best_image_gauge, image_scores
from .line_sets import line_scores
from .score import Score
from .shape_scores import set_scores, shape_scores
from .shape_sets import coverage, minimum_matching_distance, one_nearest_neighbour_accuracy
from .silhouette_sets import silhouette_features, silhouette_scores
from .views import ViewAccuracy, chance_level, of_ceiling, view_accuracy, view_scores

__all__ = [
    "Gauge",
    "Score",
    "ViewAccuracy",
    "apply",
    "apply_to_images",
    "best_gauge",
    "best_image_gauge",
    "chamfer",
    "chance_level",
    "confusion_picture",
    "coverage",
    "cubic_kernel",
    "density_coverage",
    "dihedral",
    "exposed_faces",
    "frechet_distance",
    "image_scores",
    "kernel_distance",
    "line_scores",
    "minimum_matching_distance",
    "of_ceiling",
    "one_minus_iou",
    "one_nearest_neighbour_accuracy",
    "precision_recall",
    "set_scores",
    "shape_scores",
    "silhouette_features",
    "silhouette_scores",
    "surface_points",
    "view_accuracy",
    "view_scores",
]
