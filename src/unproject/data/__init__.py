"""Collections and their readers: folders of pictures, arrays, 3-D collections, the procedural chairs, and digits."""

from .collection import Collection, read, read_images, read_shapes
from .digits import digit_labels, digits
from .download import PUBLIC, get
from .flips import with_flips
from .inspection import Inspection, contact_sheet, inspect
from .observing import observe
from .procedural.light import mixed_probes, procedural_probes
from .procedural.materials.materials import correlated, metal, plastic, wood
from .procedural.shapes.birds import birds
from .procedural.shapes.cars import cars
from .procedural.shapes.chairs import BACKS, BASES, PARAMETERS, build_chairs, chair_parameters, chairs
from .readers.framing import AS_GIVEN, Framed, Framing, UnusablePicture, frame
from .readers.patches import material_patches
from .readers.photographs import holds_sightings, read_sightings
from .readers.probes import probe_records, read_probe, read_probes, resample_probe
from .readers.textures import material_records, read_material, read_materials
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
