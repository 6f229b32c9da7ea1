"""Collections and their readers: folders of pictures, arrays, 3-D collections, the procedural chairs."""

from .chairs import BACKS, BASES, PARAMETERS, build_chairs, chair_parameters, chairs
from .collection import Collection, read, read_shapes
from .flips import with_flips
from .framing import AS_GIVEN, Framed, Framing, UnusablePicture, frame
from .inspection import Inspection, contact_sheet, inspect
from .rendered import render_silhouettes
from .sampling import batch_rows, held_out

__all__ = [
    "AS_GIVEN",
    "BACKS",
    "BASES",
    "PARAMETERS",
    "Collection",
    "Framed",
    "Framing",
    "Inspection",
    "UnusablePicture",
    "batch_rows",
    "build_chairs",
    "chair_parameters",
    "chairs",
    "contact_sheet",
    "frame",
    "held_out",
    "inspect",
    "read",
    "read_shapes",
    "render_silhouettes",
    "with_flips",
]
