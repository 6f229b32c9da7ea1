"""Tensor operations: rotation, resampling, line integrals, occupancy along rays, hulls, parts, outlines, widths."""

from __future__ import annotations

from .feet import round_feet
from .framing import aspect, bounding_box, common_fill, common_height, framed, unit_sized
from .hull import visual_hull
from .limits import limited, penalised
from .line_integrals import strip_integrals
from .occupancy import absorption, any_occupied, capped_sum, expected_depth
from .outlines import level_share, mirror_iou
from .parts import face_connected, floating_parts, joined_parts, largest_part
from .refinement import refined
from .resampling import orthographic_rays, perspective_rays, pinhole_rays, ray_points, sample_volume
from .rotation import camera_frame, quarter_turn, reflect_x, rotate, rotate_image, rotate_y
from .thin_parts import level_of_thin_parts, with_thin_parts
from .turning import turn_image
from .widths import local_widths

__all__ = [
    "absorption",
    "any_occupied",
    "aspect",
    "bounding_box",
    "camera_frame",
    "common_fill",
    "common_height",
    "capped_sum",
    "expected_depth",
    "face_connected",
    "floating_parts",
    "framed",
    "joined_parts",
    "largest_part",
    "level_of_thin_parts",
    "level_share",
    "limited",
    "local_widths",
    "mirror_iou",
    "orthographic_rays",
    "perspective_rays",
    "pinhole_rays",
    "penalised",
    "quarter_turn",
    "ray_points",
    "refined",
    "reflect_x",
    "rotate",
    "rotate_image",
    "rotate_y",
    "round_feet",
    "sample_volume",
    "strip_integrals",
    "turn_image",
    "unit_sized",
    "visual_hull",
    "with_thin_parts",
]
