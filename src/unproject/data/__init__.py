"""Collections and their readers: folders of pictures, arrays, 3-D collections, the procedural chairs, and digits."""

from .chairs import BACKS, BASES, PARAMETERS, build_chairs, chair_parameters, chairs
from .collection import Collection, read, read_images, read_shapes
from .digits import digit_labels, digits
from .download import PUBLIC, get
from .flips import with_flips
from .framing import AS_GIVEN, Framed, Framing, UnusablePicture, frame
from .inspection import Inspection, contact_sheet, inspect
from .observing import observe
from .sampling import batch_rows, held_out

__all__ = [
    "AS_GIVEN",
    "BACKS",
    "BASES",
    "PARAMETERS",
    "PUBLIC",
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
    "digit_labels",
    "digits",
    "frame",
    "get",
    "held_out",
    "inspect",
    "observe",
    "read",
    "read_images",
    "read_shapes",
    "with_flips",
]
