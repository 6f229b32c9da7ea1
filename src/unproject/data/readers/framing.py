"""Framing: the one rule by which a picture becomes a silhouette in the frame.

1. Coverage. If the picture has an alpha channel that cuts something out, its coverage is the alpha; rims around
   photographs, rounded corners and single pixels cut nothing out (`opaque_part`) and are left out. Otherwise it
   is the distance from the background, d = max over channels |I - b|, where b is the median colour of the
   border. So a white mask on black, a black mask on white and a product photograph on a plain backdrop all give
   coverage near 0 outside the object: the polarity is read off the border. Of a mask whose object takes more than a
   tenth of the border, as close crops are, it is that of most masks of the folder whose border tells it; where most
   are so close, all show light objects. `polarity="light"` (object light, b = 0) or `"dark"` (object dark, b = 1) is
   of all. What has two values alone is a mask whatever they are: labels 0 and 1 are coverage 0 and 1. If there are a
   few labels of nearly the background's value, all of them are the object; beside these, 255 is the void around
   objects, as segmentations mark it, and left out.
2. Threshold. A pixel belongs to the object if its coverage is at least `threshold`; in a photograph (a picture
   in which fewer than nine in ten pixels inside the object are nearly as far from the background as can be) at
   least `photo_threshold`, because pale parts are close to a pale backdrop. A photograph of whose border nearly
   half belongs to the object stands before no plain backdrop, and is skipped unless a polarity is given. Parts of
   less than a thousandth of the largest one are dirt and left out.
3. Crop. The object's bounding box is centred in a square whose side is the box's longer side / `fill`
   (0.85: a margin of 7.5 % on both sides). Aspect is kept. What the square takes in beyond the picture is empty.
4. Resampling. Every pixel of the (size, size) result is the share of its area that the object covers, a
   soft value in [0, 1]; `binary` cuts it at one half.

`mode="keep"` leaves out step 3 for masks that are framed already: the picture is padded to a square and resampled;
with `threshold=None` as well (`AS_GIVEN`), values are kept as they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from scipy.ndimage import binary_erosion, label
from torch import Tensor
from torch.nn import functional

from ..._pictures import UnusablePicture
from ..._types import UserError
from ...ops.resampling import interval_shares
from .borders import border, border_colour, bounding_box
from .transparency import NO_MARGINS, opaque_part

Mode = Literal["crop", "keep"]
Polarity = Literal["auto", "light", "dark"]
Window = tuple[float, float, float]

UNEVEN = 0.47
"""Share of a photograph's border that may differ from its backdrop: close crops touch it, grass below sky is half."""
LABELS, NEAR = 4, 0.1
"""Values at most of a segmentation in one picture, and how far from the background its labels are."""
ANOTHER = 0.2
"""Size from which on a part counts as another object, of the largest part's."""
TOUCHED, SPECK = 0.1, 1e-3
"""Share of a mask's border that its object takes, beyond which the border does not tell the polarity. And the size of
dirt, of the largest part's."""


@dataclass(frozen=True)
class Framing:
    """How pictures are made silhouettes: see the module's docstring for the rule.

    Attributes:
        mode: "crop" centres and scales the object, "keep" leaves it where it is.
        threshold: coverage at which a pixel belongs to the object; None keeps the values (mode "keep" only).
        photo_threshold: the same for photographs on a plain backdrop.
        fill: the object's longer side as a share of the frame's.
        polarity: "auto" reads the background off the border; else the object is "light" or "dark".
        undecided: what objects are in masks whose border does not tell: "light", or "dark" (`as_most`).
        close: masks are cut so closely that no border tells.
        binary: cut the result at one half.
        min_pixels: an object whose longer side is shorter is skipped.
    """

    mode: Mode = "crop"
    threshold: float | None = 0.5
    photo_threshold: float = 0.08
    fill: float = 0.85
    polarity: Polarity = "auto"
    binary: bool = False
    min_pixels: int = 8
    undecided: Literal["light", "dark"] = "light"
    close: bool = False

    def __post_init__(self) -> None:
        if self.mode not in ("crop", "keep") or self.polarity not in ("auto", "light", "dark"):
            raise UserError(
                f"framing: mode is crop or keep, polarity auto, light or dark; not {self.mode}, {self.polarity}"
            )
        if self.threshold is None and self.mode == "crop":
            raise UserError("framing: cropping needs a threshold between 0 and 1 to find the object")
        for name in ("threshold", "photo_threshold", "fill"):
            value = getattr(self, name)
            if value is not None and not 0 < value <= 1:
                raise UserError(f"framing: {name} is above 0 and at most 1, not {value}")

    def as_most(self, pictures: Iterable[np.ndarray]) -> Framing:
        """Return the rule for masks like these (H, W, C), where it reads polarities off borders."""
        if self.polarity != "auto":
            return self
        told, masks = [], 0
        for picture in pictures:
            coverage, background = coverage_of(opaque_part(picture)[0])
            if background != "transparent" and is_mask(coverage):
                masks += 1
                told += [background] if _is_told(coverage >= 0.5) else []
        close = masks > 2 * len(told)
        dark = told.count("light") > told.count("dark") and not close
        return replace(self, undecided="dark" if dark else "light", close=close)


AS_GIVEN = Framing(mode="keep", threshold=None, polarity="light")
"""Values as they are: only the size changes. The default for arrays, which somebody has prepared."""


@dataclass(frozen=True)
class Framed:
    """A framed picture and how it came about.

    Attributes:
        image: (1, size, size) coverage in [0, 1].
        channel: "alpha", "luminance" (of a mask) or "photograph".
        background: "transparent", "dark" or "light".
        width, height: of the picture it was made from, in pixels.
        cut: the object touches one side of the picture, two adjacent ones or three: the border may cut it off. What
            is trimmed touches all four, or two opposite ones.
        parts: how many parts of the object are at least a fifth of the largest.
    """

    image: Tensor
    channel: str
    background: str
    width: int
    height: int
    cut: bool = False
    parts: int = 1


def _is_told(mask: np.ndarray) -> bool:
    """Whether the border tells the polarity of a mask: its object takes little of it, and less than of the picture.

    What stands on the border takes a smaller share of it than of the picture; the ground in the corners of a picture
    that was cut closely, taken for the object, a larger one.
    """
    return bool(border(mask).mean() <= min(TOUCHED, mask.mean()))


def frame(picture: np.ndarray, size: int, framing: Framing | None = None) -> Framed:
    """Frame a picture (H, W), or (H, W, C) with C of 1 to 4 (2 and 4: the last is alpha), of values in [0, 1].

    Raises:
        UnusablePicture: if it shows no object, nothing but the object, or one that is too small.
    """
    rule = Framing() if framing is None else framing
    picture = picture[..., None] if picture.ndim == 2 else picture
    part, margins = (picture, NO_MARGINS) if rule.threshold is None else opaque_part(picture)
    try:
        coverage, channel, background = _object_of(part, rule)
    except UnusablePicture as reason:
        rim = "" if part is picture else "; its transparency cuts nothing out"
        raise UnusablePicture(f"{reason}{rim}") from None
    cut, parts = (_is_cut(coverage), _parts_of(coverage)) if rule.threshold is not None else (False, 1)
    coverage = np.pad(coverage, margins)
    window = whole_window(coverage) if rule.mode == "keep" else object_window(coverage, rule.fill)
    image = torch.from_numpy(area_resample(coverage, window, size))[None]
    height, width = coverage.shape
    return Framed((image >= 0.5).float() if rule.binary else image, channel, background, width, height, cut, parts)


def _object_of(picture: np.ndarray, rule: Framing) -> tuple[np.ndarray, str, str]:
    """Steps 1 and 2: the coverage (H, W) of a picture (H, W, C), its channel and its background."""
    labels = rule.threshold is not None
    coverage, background = coverage_of(picture, rule.polarity, labels)
    untold = rule.close or border(coverage >= 0.5).mean() > TOUCHED
    if untold and rule.polarity == "auto" and background != "transparent" and is_mask(coverage):
        coverage, background = coverage_of(picture, rule.undecided, labels)
    channel = "alpha" if background == "transparent" else "luminance"
    if rule.threshold is None:
        return coverage, channel, background
    photograph = channel == "luminance" and not is_mask(coverage)
    coverage = without_specks(coverage >= (rule.photo_threshold if photograph else rule.threshold))
    _check_object(coverage, rule.min_pixels)
    if photograph and rule.polarity == "auto":
        _check_backdrop(coverage)
    return coverage, "photograph" if photograph else channel, background


def coverage_of(picture: np.ndarray, polarity: Polarity = "auto", labels: bool = True) -> tuple[np.ndarray, str]:
    """Step 1: the coverage (H, W) of a picture (H, W, C), and what its background is; of few values as `labels`."""
    channels = picture.shape[-1]
    if channels in (2, 4):
        if picture[..., -1].min() < 1:
            return picture[..., -1].astype(np.float32), "transparent"
        picture = picture[..., :-1]
    background = {"light": 0.0, "dark": 1.0}.get(polarity)
    colour = border_colour(picture) if background is None else np.full(picture.shape[-1], background)
    distance = np.abs(picture - colour).max(-1).astype(np.float32)
    return _of_labels(distance) if labels else distance, "light" if colour.mean() > 0.5 else "dark"


def _of_labels(distance: np.ndarray) -> np.ndarray:
    """Of two values alone 0 and 1, whatever they are, of a segmentation's labels the objects'; others as they are."""
    distance = _without_void(distance)
    highest = distance.max()
    if 0 < highest < 1 and np.isin(distance, (0, highest)).all():
        distance = distance / highest
    return distance


def _without_void(distance: np.ndarray) -> np.ndarray:
    """Of a segmentation's labels the objects', as coverage 0 and 1; other distances (H, W) as they are."""
    labels, highest = (distance > 0) & (distance < NEAR), distance.max()
    void = (distance == highest) & ~labels
    if labels.sum() <= void.sum() or not (labels | void | (distance == 0)).all():
        return distance
    return labels.astype(np.float32) if len(np.unique(distance)) <= LABELS else distance


def _is_cut(mask: np.ndarray) -> bool:
    top, bottom, left, right = (side.any() for side in (mask[0], mask[-1], mask[:, 0], mask[:, -1]))
    return bool((top != bottom) or (left != right))


def _parts_of(mask: np.ndarray) -> int:
    parts, _ = label(mask > 0, np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    sizes = np.bincount(parts.ravel())[1:]
    return int((sizes >= ANOTHER * sizes.max()).sum())


def without_specks(mask: np.ndarray) -> np.ndarray:
    """A mask (H, W) of bools as float32, without parts that are below a thousandth of the largest, diagonals joined."""
    parts, count = label(mask, np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    if count > 1:
        sizes = np.bincount(parts.ravel())
        mask = mask & (sizes >= SPECK * sizes[1:].max())[parts]
    return mask.astype(np.float32)


def is_mask(coverage: np.ndarray) -> bool:
    """Whether nine in ten pixels inside the object, its soft edge left aside, are nearly as far as can be."""
    inside = coverage[binary_erosion(coverage > 0.1, iterations=2)]
    return inside.size == 0 or bool((inside > 0.9).mean() >= 0.9)


def _check_object(mask: np.ndarray, min_pixels: int) -> None:
    share = mask.mean()
    if share == 0:
        raise UnusablePicture("empty: no pixel reaches the threshold")
    if share > 0.99:
        raise UnusablePicture("full: the object covers the whole picture, no outline is left")
    _, height, width = bounding_box(mask)
    if max(height, width) < min_pixels:
        raise UnusablePicture(f"too small: the object is {width} x {height} pixels, {min_pixels} are needed")


def _check_backdrop(mask: np.ndarray) -> None:
    share = border(mask).mean()
    if share > UNEVEN:
        raise UnusablePicture(
            f"no plain backdrop: {share:.0%} of the photograph's border differ from it; cut the object out, or give "
            "--polarity or --threshold"
        )


def object_window(mask: np.ndarray, fill: float) -> Window:
    """Step 3: (top, left, side) in pixels of the square in which the object is centred."""
    (top, left), height, width = bounding_box(mask)
    side = max(height, width) / fill
    return top + height / 2 - side / 2, left + width / 2 - side / 2, side


def whole_window(mask: np.ndarray) -> Window:
    """The square, in pixels, around the whole picture."""
    height, width = mask.shape
    side = max(height, width)
    return (height - side) / 2, (width - side) / 2, float(side)


def area_resample(image: np.ndarray, window: Window, size: int) -> np.ndarray:
    """Step 4: (size, size) area averages of a window of an image (H, W); outside the image is 0."""
    top, left, side = window
    down = cells(image.shape[0], top, top + side, size).numpy()
    across = cells(image.shape[1], left, left + side, size).numpy()
    return np.clip(down @ image.astype(np.float32) @ across.T, 0, 1)


def centred_square(images: Tensor, size: int) -> Tensor:
    """(N, C, size, size) of the largest centred square of images (N, C, H, W): area averages, bilinear to grow."""
    side = min(images.shape[-2:])
    top, left = ((length - side) // 2 for length in images.shape[-2:])
    images = images[..., top : top + side, left : left + side]
    if size > side:
        return functional.interpolate(images, size=(size, size), mode="bilinear", align_corners=False)
    weights = cells(side, 0, side, size).to(images)
    return torch.einsum("ih,nchw,jw->ncij", weights, images, weights)


def cells(count: int, low: float, high: float, size: int) -> Tensor:
    """(size, count): the share of output cell i, one of `size` in [low, high], that lies in input cell [j, j+1]."""
    target = torch.linspace(low, high, size + 1, dtype=torch.float64)
    return interval_shares(torch.arange(count + 1, dtype=torch.float64), target).float()
