"""Folders of pictures: masks, RGBA cut-outs, photographs on a plain backdrop; or pictures as they are.

Files are taken recursively and in the order of their names. One that cannot be used is named and skipped. A file
`views.csv` beside the pictures makes the views known.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import torch

from ..._files import files_with
from ..._pictures import UnusablePicture, read_displayed
from ..._types import UserError
from ..sampling import spread_rows
from .found import Found, to_bytes
from .framing import Framing, frame
from .images import as_images
from .options import ReadOptions
from .surveying import Item, Read, Survey, survey
from .views import views_beside

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
SIZE = 64
LOOKED_AT = 64
"""Pictures of a folder that are looked at to tell whether objects are light or dark in most of them."""
UNREAD = (
    ".heic", ".heif", ".avif", ".jxl", ".jp2", ".gif", ".svg", ".psd", ".xcf",
    ".jfif", ".jpe", ".tga", ".dds", ".pbm", ".pgm", ".ppm", ".pnm",
    ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".exr", ".hdr", ".dcm", ".mrc",
)  # fmt: skip
"""Of telephones, cameras, browsers, editors, renderers and scanners, which no reader of masks and images takes."""
STRANGE_SHARE, MIN_SILHOUETTES = 0.1, 20
"""Share of silhouettes, and how many, from which on strange ones are told of; masks of single objects have 4 %."""
SAVE = "save it as .jpg, .png or .tif"


def read_pictures(path: Path, options: ReadOptions) -> Found:
    """Read a folder's pictures: silhouettes (N, 1, size, size), 64 by default; or images, as stored by default.

    Raises:
        UserError: if there is no folder, no picture, none that can be used, with `strict` one that cannot, or
            if `views.csv` does not fit.
    """
    found = survey_pictures(path, options)
    warn_of_objects(path, found.used.values())
    return found_of(path, tuple(found.skipped.items()), tuple(found.used), stacked(path, found))


def survey_pictures(path: Path, options: ReadOptions) -> Survey:
    """Read every picture of a folder: as it is, or as a silhouette."""
    files = required_pictures(path, (*SUFFIXES, *UNREAD))
    return survey(path, files, reading(options, files), options.strict)


def reading(options: ReadOptions, files: Sequence[Path]) -> Read:
    """Return what reads one of these files; it says of those that no reader takes what to do."""
    size, framing = options.size or SIZE, options.framing or Framing()
    if not options.images:
        framing = framing.as_most(_some(files))

    def read(file: Path) -> Item:
        if file.suffix.lower() in UNREAD:
            raise UnusablePicture(f"{file.suffix} is not read; {SAVE}")
        return _image(file, options) if options.images else _silhouette(file, size, framing)

    return read


def _some(files: Sequence[Path]) -> Iterator[np.ndarray]:
    """Pictures (H, W, C) of those files of which one can be made, `LOOKED_AT` at most, spread over them."""
    for row in spread_rows(len(files), LOOKED_AT).tolist():
        if files[row].suffix.lower() in SUFFIXES:
            with suppress(UnusablePicture):
                yield unit_values(read_displayed(files[row], labels=True))


def _silhouette(file: Path, size: int, framing: Framing) -> Item:
    """The coverage (1, size, size) of a framed picture, in 8 bits."""
    framed = frame(unit_values(read_displayed(file, labels=True)), size, framing)
    kind = "alpha" if framed.channel == "alpha" else f"{framed.channel} on {framed.background} background"
    kind += f", in {framed.parts} parts" if framed.parts > 1 else ""
    kind += ", cut off by the border it seems" if framed.cut else ""
    return Item(to_bytes(framed.image).numpy(), kind, framed.width, framed.height, framed.parts > 1, framed.cut)


def _image(file: Path, options: ReadOptions) -> Item:
    pixels = torch.from_numpy(np.moveaxis(read_displayed(file), 2, 0).copy())
    values = as_images(pixels[None], options.size, options.colour)[0].numpy()
    return Item(values, "picture", pixels.shape[2], pixels.shape[1])


def warn_of_objects(path: Path, items: Collection[Item]) -> None:
    """Warn if many silhouettes show more than one object, as where there are captions, or a part of one."""
    for name, what in (("several", "in several parts, as of two objects or a caption"), ("cut", "cut off by a border")):
        count = sum(getattr(item, name) for item in items)
        if len(items) >= MIN_SILHOUETTES and count > STRANGE_SHARE * len(items):
            warnings.warn(
                f"{path}: {count} of {len(items)} silhouettes are {what}, it seems; see unproject data inspect {path}",
                stacklevel=2,
            )


def stacked(path: Path, found: Survey) -> np.ndarray:
    """The pictures that are used, (N, C, H, W): float32 if one of them is, else uint8.

    Raises:
        UserError: if there is none, or they are of different sizes.
    """
    check_used(path, len(found.used), tuple(found.skipped.items()))
    check_sizes(path, {item.values.shape[1:]: name for name, item in reversed(found.used.items())})
    return alike([item.values for item in found.used.values()])


def alike(images: Sequence[np.ndarray]) -> np.ndarray:
    """Stack images: as floats in [0, 1] if one of them is."""
    if any(image.dtype != np.uint8 for image in images):
        images = [unit_values(image) for image in images]
    return np.stack(images)


def check_used(path: Path, used: int, skipped: Sequence[tuple[str, str]]) -> None:
    """Refuse a folder of which no picture can be used."""
    if not used:
        name, reason = skipped[0]
        raise UserError(
            f"{path}: none of the {len(skipped)} pictures can be used ({name}: {reason}); "
            f"see `unproject data inspect {path}`, whose flags `unproject data pack` takes too"
        )


def check_sizes(path: Path, sizes: Mapping[tuple[int, ...], str]) -> None:
    """Refuse pictures of several sizes, (H, W) → the name of one."""
    if len(sizes) > 1:
        listed = ", ".join(f"{name} {width} x {height}" for (height, width), name in [*sizes.items()][:2])
        raise UserError(f"{path}: pictures are of different sizes ({listed}); give a size to bring them to")


TWELVE_BITS = 4095.5 / 65535
"""The largest value of pictures that hold 12 bits in 16."""


def found_of(path: Path, skipped: Sequence[tuple[str, str]], names: Sequence[str], items: np.ndarray) -> Found:
    """What was found in a folder, with its known views."""
    latents = views_beside(path, names, [name for name, _ in skipped])
    if items.dtype != np.uint8 and 0 < items.max() <= TWELVE_BITS:
        warnings.warn(
            f"{path}: no pixel of pictures of 16 bits is over {65535 * items.max():.0f} of 65535, as if they held 12 "
            "bits or less: they are learned as dark as they are; multiply their values, or save them as floats in "
            "[0, 1]",
            stacklevel=2,
        )
    white = 255 if items.dtype == np.uint8 else 1
    return Found(torch.from_numpy(items), names, latents, tuple(skipped), str(path), white)


def required_pictures(path: Path, suffixes: Sequence[str] = SUFFIXES) -> list[Path]:
    """The pictures in a folder and its subfolders. Raises UserError if there is none."""
    if path.is_file():
        raise UserError(f"{path}: is a file; name a folder of pictures")
    if not path.is_dir():
        raise UserError(f"{path}: there is no such folder; check the path")
    files = files_with(path, suffixes)
    if not files:
        raise UserError(f"{path}: holds no picture; put {', '.join(s[1:] for s in SUFFIXES)} files there")
    return files


def unit_values(pixels: np.ndarray) -> np.ndarray:
    """float32 in [0, 1] of uint8 pixels; floats as they are."""
    return pixels.astype(np.float32) / 255 if pixels.dtype == np.uint8 else pixels
