"""Collections, their readers and the procedural data sets.

`Collection` and `read` take what a path holds; `chairs`, `birds`, `cars`, `wood`, `metal`, `plastic`, `fabric` and
`correlated` are made from formulas; `digits` are embedded; `observe` renders items as a camera would have collected
them.
"""

from .collection import Collection
from .digits import digit_labels, digits
from .download import PUBLIC, get
from .flips import with_flips
from .inspection import Inspection, inspect
from .listed import are_pictures, read_photographs, read_silhouettes
from .mapping import mapped
from .material_inspection import holds_materials, holds_textures, inspect_materials
from .observing import observe
from .packing import Packed, pack
from .procedural.light import daylight_probes, mixed_probes, procedural_probes
from .procedural.materials.materials import correlated, fabric, metal, plastic, wood
from .procedural.shapes.birds import birds
from .procedural.shapes.cars import cars
from .procedural.shapes.chairs import BACKS, BASES, PARAMETERS, build_chairs, chair_parameters, chairs
from .readers.framing import AS_GIVEN, Framed, Framing, UnusablePicture, frame
from .readers.lights import OBSERVATIONS, photographed, refuse_unsorted, unsorted
from .readers.options import ReadOptions
from .readers.patches import material_patches
from .readers.probes import read_probe, read_probes, resample_probe
from .readers.sides import detectors_of, picture_count, side_of
from .readers.texture_maps import Convention
from .readers.textures import read_material
from .reading import read
from .sampling import batch_rows
from .symmetry import plane_of_symmetry

__all__ = [
    "AS_GIVEN",
    "BACKS",
    "BASES",
    "OBSERVATIONS",
    "PARAMETERS",
    "PUBLIC",
    "Collection",
    "Convention",
    "Framed",
    "Framing",
    "ReadOptions",
    "Inspection",
    "Packed",
    "UnusablePicture",
    "are_pictures",
    "batch_rows",
    "birds",
    "build_chairs",
    "cars",
    "chair_parameters",
    "chairs",
    "correlated",
    "daylight_probes",
    "detectors_of",
    "digit_labels",
    "digits",
    "fabric",
    "frame",
    "get",
    "holds_materials",
    "holds_textures",
    "inspect",
    "inspect_materials",
    "mapped",
    "material_patches",
    "metal",
    "mixed_probes",
    "observe",
    "pack",
    "photographed",
    "plane_of_symmetry",
    "plastic",
    "procedural_probes",
    "read",
    "read_material",
    "read_photographs",
    "read_probe",
    "read_probes",
    "read_silhouettes",
    "refuse_unsorted",
    "resample_probe",
    "picture_count",
    "side_of",
    "unsorted",
    "with_flips",
    "wood",
]
