"""Collections and their readers: folders of pictures, arrays, 3-D collections, the procedural chairs, and digits."""

from .birds import birds
from .cars import cars
from .chairs import BACKS, BASES, PARAMETERS, build_chairs, chair_parameters, chairs
from .collection import Collection, read, read_images, read_shapes
from .digits import digit_labels, digits
from .download import PUBLIC, get
from .flips import with_flips
from .framing import AS_GIVEN, Framed, Framing, UnusablePicture, frame
from .inspection import Inspection, contact_sheet, inspect
from .material_sets import material_records, read_material, read_materials
from .materials import correlated, metal, plastic, wood
from .observing import observe
from .patches import material_patches
from .probes import probe_records, read_probe, read_probes, resample_probe
from .procedural_probes import mixed_probes, procedural_probes
from .sampling import batch_rows, held_out
from .sightings import holds_sightings, read_sightings

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
    "birds",
    "build_chairs",
    "cars",
    "chair_parameters",
    "chairs",
    "contact_sheet",
    "correlated",
    "digit_labels",
    "digits",
    "frame",
    "get",
    "held_out",
    "holds_sightings",
    "inspect",
    "material_patches",
    "material_records",
    "metal",
    "observe",
    "plastic",
    "probe_records",
    "mixed_probes",
    "procedural_probes",
    "read",
    "read_images",
    "read_material",
    "read_materials",
    "read_probe",
    "read_probes",
    "read_shapes",
    "read_sightings",
    "resample_probe",
    "with_flips",
    "wood",
]
