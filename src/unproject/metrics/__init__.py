"""Scores, each with its protocol: shape sets and views up to gauge, sets of silhouettes."""

from .confusion import confusion_picture
from .distances import chamfer, exposed_faces, one_minus_iou, surface_points
from .gauge import Gauge, apply, best_gauge, dihedral
from .score import Score
from .shape_scores import set_scores, shape_scores
from .shape_sets import coverage, minimum_matching_distance, one_nearest_neighbour_accuracy
from .silhouette_sets import cubic_kernel, kernel_distance, silhouette_features, silhouette_scores
from .views import ViewAccuracy, chance_level, of_ceiling, view_accuracy, view_scores

__all__ = [
    "Gauge",
    "Score",
    "ViewAccuracy",
    "apply",
    "best_gauge",
    "chamfer",
    "chance_level",
    "confusion_picture",
    "coverage",
    "cubic_kernel",
    "dihedral",
    "exposed_faces",
    "kernel_distance",
    "minimum_matching_distance",
    "of_ceiling",
    "one_minus_iou",
    "one_nearest_neighbour_accuracy",
    "set_scores",
    "shape_scores",
    "silhouette_features",
    "silhouette_scores",
    "surface_points",
    "view_accuracy",
    "view_scores",
]
