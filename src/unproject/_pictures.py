"""Files of pictures: `read_stored` for every channel as it is stored, `read_displayed` for what a viewer shows.

OpenImageIO reads what is stored (.hdr, .exr, 16 bits, .png and others), Pillow what is displayed: turned as the camera
says, palettes resolved.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ._files import atomic_path, check_unpacked
from ._silence import silenced
from ._types import UserError

if TYPE_CHECKING:
    from PIL import Image

MOST_PIXELS, LONGEST = 2**27, 2**15  # 11600², and pixels a side: larger ones are mistakes or bombs
OVERSHOOT = 0.02  # how far filters may take stored floats out of [0, 1]
TIFF, BITS_PER_SAMPLE = (".tif", ".tiff"), 258  # and its tag
MOST_SHOWN = 2**24
"""Pixels of which more make a displayed picture be read at half its size, or a third, ..."""
VOID, MOST_LABELS = 255, 32
"""The label of what is no object and no ground, and values of a picture beyond which they are no labels."""
Depth = Literal["uint8", "uint16", "half", "float"]


class UnusablePicture(ValueError):
    """This picture cannot be used; the message is the reason."""


class Picture(NamedTuple):
    """Pixels (H, W, C) float32, integers scaled to [0, 1] as they are stored, and what they were stored as."""

    pixels: np.ndarray
    stored: str


def read_stored(path: str | os.PathLike[str]) -> Picture:
    """Read all channels of the first image of a file, turned as its camera says, without conversion of colours.

    Raises:
        UserError: if the file is missing, is no picture, is damaged or truncated, or is too large.
    """
    import OpenImageIO as oiio  # noqa: N813

    name = os.fspath(path)
    if not os.path.isfile(name):
        raise UserError(f"{name}: there is no such file; check the path")
    with silenced():
        if not name.lower().endswith((".hdr", ".exr")):
            _decoded(name)
        config = oiio.ImageSpec()
        config.attribute("oiio:UnassociatedAlpha", 1)
        file = oiio.ImageInput.open(name, config)
        if file is None:
            reason = _said(oiio.geterror)
            raise UserError(f"{name}: not a picture that can be read ({reason}); give a whole file")
        try:
            return _read(name, file)
        finally:
            file.close()


def _read(name: str, file: Any) -> Picture:
    spec = file.spec()
    _check_size(name, spec.width, spec.height, spec.nchannels)
    pixels = file.read_image("float")
    if pixels is None or file.has_error:
        raise UserError(f"{name}: damaged or truncated ({_said(file.geterror)}); give a whole file")
    turned = TURNED.get(spec.get_int_attribute("Orientation", 1), TURNED[1])
    return Picture(turned(np.atleast_3d(np.asarray(pixels, np.float32))), str(spec.format))


TURNED: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    1: lambda x: x,
    2: lambda x: x[:, ::-1],
    3: lambda x: x[::-1, ::-1],
    4: lambda x: x[::-1],
    5: lambda x: x.swapaxes(0, 1),
    6: lambda x: x.swapaxes(0, 1)[:, ::-1],
    7: lambda x: x.swapaxes(0, 1)[::-1, ::-1],
    8: lambda x: x.swapaxes(0, 1)[::-1],
}
"""What shows a picture of a value of Exif's Orientation upright."""


def _check_size(name: str, width: int, height: int, channels: int) -> None:
    if width * height > MOST_PIXELS or max(width, height) > LONGEST:
        raise UserError(f"{name}: {width} × {height} pixels are too many; give at most {MOST_PIXELS}, {LONGEST} a side")
    check_unpacked(name, 4 * width * height * channels)


def _decoded(name: str) -> None:
    """Pillow reads ordinary pictures first: it tells damaged ones more reliably."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the limit is ours
            with Image.open(name) as picture:
                _check_size(name, picture.width, picture.height, len(picture.getbands()))
                picture.load()
    except UserError:
        raise
    except Exception as error:  # its decoders raise whatever damaged files make them run into
        if isinstance(error, UnidentifiedImageError) and name.lower().endswith(TIFF):
            return  # it reads no floats in colour
        raise UserError(f"{name}: not a picture that can be read ({_reason(str(error))}); give a whole .png") from error


def write_picture(path: str | os.PathLike[str], pixels: Any, depth: Depth) -> None:
    """Write (H, W) or (H, W, C); integers are scaled from [0, 1] and clamped. The format is the suffix's.

    Raises:
        OSError: if the disk refuses; no file is left half-written.
    """
    import OpenImageIO as oiio  # noqa: N813

    pixels = np.ascontiguousarray(np.atleast_3d(np.asarray(pixels, np.float32)))
    height, width, channels = pixels.shape
    with atomic_path(path) as temporary:
        file = oiio.ImageOutput.create(str(temporary))
        if file is None:
            raise UserError(f"{path}: {_said(oiio.geterror)}; give a name that ends in .png, .exr or .hdr")
        spec = oiio.ImageSpec(width, height, channels, depth)
        spec.attribute("oiio:UnassociatedAlpha", 1)
        written = file.open(str(temporary), spec) and file.write_image(pixels) and file.close()
        if not written:
            raise OSError(f"{path}: {_said(file.geterror)}")


def _said(ask: Callable[[], str]) -> str:
    """What the library says of its error; of damaged files that is at times no text at all."""
    try:
        return _reason(ask())
    except UnicodeDecodeError:
        return "damaged"


def _reason(text: str) -> str:
    return " ".join(text.split())[:120] or "unknown format"


def read_displayed(file: Path, labels: bool = False) -> np.ndarray:
    """Read a picture (H, W, C), C = 1 to 4, turned as its camera says: uint8, or float32 in [0, 1] of deeper grey ones.

    Args:
        labels: read segmentations with a palette as their labels.

    Raises:
        UnusablePicture: if it cannot be read, or is so large that Pillow takes it for a decompression bomb.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with silenced(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            # From a stream: what Pillow maps into memory it takes for as wide as it is high if Exif turns it.
            with file.open("rb") as stream, Image.open(stream) as picture:
                check_sides(*picture.size)
                return _displayed(picture, labels)
    except UnusablePicture:
        raise
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise UnusablePicture(f"too large: over {Image.MAX_IMAGE_PIXELS} pixels; make it smaller") from None
    except UnidentifiedImageError:
        raise UnusablePicture(_why_unidentified(file)) from None
    except Exception as error:  # its decoders raise whatever damaged files make them run into
        raise UnusablePicture(f"unreadable: {_cause(error)}") from None


def _why_unidentified(file: Path) -> str:
    """Say of a picture that Pillow does not identify whether it is one that OpenImageIO reads."""
    import OpenImageIO as oiio  # noqa: N813

    with silenced():
        found = oiio.ImageInput.open(str(file)) if file.suffix.lower() in TIFF else None
        if found is not None and "int" not in str(found.spec().format):
            return "holds floats in colour; save it as 8 or 16 bits"
    oiio.geterror()  # which would be told at the end of the process
    return "unreadable: no picture of a known format"


def check_sides(width: int, height: int) -> None:
    """Refuse strips: whatever averages a side takes memory by its length.

    Raises:
        UnusablePicture: if a side is longer than `LONGEST`.
    """
    if max(width, height) > LONGEST:
        raise UnusablePicture(f"too large: {width} x {height} pixels; a side has at most {LONGEST}")


def _cause(error: BaseException) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__


def _displayed(picture: Image.Image, labels: bool) -> np.ndarray:
    from PIL import ImageOps

    _check_one(picture)
    if picture.mode.startswith(("I", "F")):
        _check_depth(picture)
        return _deep(ImageOps.exif_transpose(picture))
    picture = _labels(picture) if labels and picture.mode == "P" else picture
    transparent = "A" in picture.getbands() or "transparency" in picture.info
    grey = picture.mode in ("1", "L", "LA")
    mode = ("LA" if grey else "RGBA") if transparent else ("L" if grey else "RGB")
    shown = picture.convert(mode)
    pixels = np.asarray(ImageOps.exif_transpose(_reduced(shown)))
    return pixels[..., None] if pixels.ndim == 2 else pixels


def _labels(picture: Image.Image) -> Image.Image:
    """Return a segmentation with a palette, as those of Pascal VOC are, as its labels; other pictures as they are.

    Of its values, few, 255 is the void around objects, whatever colour it is shown in; of 0 and 255 alone it is not.
    """
    values = {value for _, value in picture.getcolors() or ()}
    if VOID not in values or values <= {0, VOID} or len(values) > MOST_LABELS or "transparency" in picture.info:
        return picture
    labels = picture.copy()
    labels.putpalette([value for value in range(256) for _ in "RGB"])
    return labels.convert("L")


def _reduced(picture: Image.Image) -> Image.Image:
    """Return a picture of about `MOST_SHOWN` pixels at most: averages, but of labels, whose averages are none, some."""
    factor = math.ceil(math.sqrt(picture.width * picture.height / MOST_SHOWN))
    if factor <= 1:
        return picture
    values = {value for _, value in picture.getcolors(MOST_LABELS) or ()} if picture.mode == "L" else set()
    if values <= {0, VOID}:
        return picture.reduce(factor)
    return picture.resize((-(-picture.width // factor), -(-picture.height // factor)), 0)  # the nearest


def _check_one(picture: Image.Image) -> None:
    """Refuse stacks and animations, of which the first frame would pass for all; a thumbnail is no further frame."""
    if picture.format not in ("TIFF", "WEBP", "PNG"):  # telephones put two pictures into a .jpg
        return
    frames, size = getattr(picture, "n_frames", 1), picture.size
    if frames > 1:
        picture.seek(1)
        if picture.size == size:
            raise UnusablePicture(f"holds {frames} frames; save each as a picture of its own")
        picture.seek(0)


def _check_depth(picture: Image.Image) -> None:
    """Refuse integers of 32 bits, of which nothing says what stands for white."""
    bits = getattr(picture, "tag_v2", {}).get(BITS_PER_SAMPLE, (16,))
    if picture.mode == "I" and max(bits) > 16:
        raise UnusablePicture(f"holds integers of {max(bits)} bits; save them as 8 or 16 bits, or as floats in [0, 1]")


def _deep(picture: Image.Image) -> np.ndarray:
    """16-bit integers are shares of 65535, as PNG and TIFF mean them; floats are as they are."""
    if picture.width * picture.height > 2 * MOST_SHOWN:
        raise UnusablePicture(f"too large: over {2 * MOST_SHOWN} pixels of more than 8 bits; make it smaller")
    values = np.asarray(picture, dtype=np.float32)[..., None]
    if not np.isfinite(values).all():
        raise UnusablePicture("unreadable: has values that are NaN or infinite")
    if picture.mode == "F" and (values.min() < -OVERSHOOT or values.max() > 1 + OVERSHOOT):
        raise UnusablePicture(f"values run from {values.min():.3g} to {values.max():.3g}; scale them to [0, 1]")
    return np.clip(values / (1.0 if picture.mode == "F" else 65535.0), 0, 1)
