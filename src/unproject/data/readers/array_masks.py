"""Masks in arrays, which are taken as they are: what they are told to be, and what nothing can be learned from."""

from __future__ import annotations

import warnings
from pathlib import Path

import torch
from torch import Tensor

from ..._pictures import UnusablePicture
from ..._types import UserError
from ..sampling import spread_rows
from .found import Found, chunks, names_of, to_bytes, to_floats, white_of, without
from .framing import AS_GIVEN, frame
from .options import ReadOptions

LOOKED_AT = 1024
"""Masks that are looked at to tell whether all are inverted."""
GREY = 0.02
"""Mean difference of channels up to which three of them are one."""


def checked_masks(path: Path, key: str, pictures: Tensor) -> Tensor:
    """Return what `_without_colours` does.

    Raises:
        UserError: for what is no mask: opaque pictures in colour, and labels with a void.
    """
    masks = _without_colours(path, key, pictures)
    _refuse_labels(path, key, masks)
    return masks


def _without_colours(path: Path, key: str, pictures: Tensor) -> Tensor:
    """Return grey pictures as masks (N, 1, H, W), cut-outs (N, 4, H, W) as they are.

    Raises:
        UserError: if they are in colour and opaque: nobody has told the object from what is around it. It says what to
            give instead.
    """
    if pictures.shape[1] == 1 or pictures.shape[1] == 4 and not _opaque(pictures):
        return pictures
    some = pictures[spread_rows(len(pictures), 64)][:, :3].float()
    if (some.amax(1) - some.amin(1)).mean() > GREY * max(float(some.max()), 1e-6):
        raise UserError(
            f"{path}: {key}: colour pictures are no masks; give masks, alpha as a fourth channel, or a folder of the "
            "pictures, in which objects are told from a plain backdrop (of surfaces: see materials)"
        )
    return pictures[:, :1]


LABELS = 25
"""Labels of a segmentation at most; Pascal VOC has 20 beside the void, 255."""


def _refuse_labels(path: Path, key: str, pictures: Tensor) -> None:
    """Refuse segmentations of 8 bits (N, 1, H, W), of which 255 is the void around objects, not an object.

    Raises:
        UserError: if more pixels are labels than void, and none is anything else.
    """
    if pictures.dtype != torch.uint8 or pictures.shape[1] != 1:
        return
    some = pictures[spread_rows(len(pictures), 64)]
    labels, void = (some > 0) & (some <= LABELS), some == 255
    if int(labels.sum()) > int(void.sum()) > 0 and bool((labels | void | (some == 0)).all()):
        raise UserError(
            f"{path}: {key}: holds labels up to {int(some[labels].max())} and 255, as segmentations mark what is void; "
            "save the masks (labels > 0) & (labels < 255)"
        )


def _opaque(pictures: Tensor) -> bool:
    """Whether the fourth channel is one value."""
    return bool((pictures[:, 3] == pictures[:, 3].max()).all())


def warn_of_axes(path: Path, key: str, shape: tuple[int, ...]) -> None:
    """Warn of an array (H, W, N) or of one picture (H, W, C), which pass for H pictures of W × N or W × C pixels."""
    one = len(shape) == 3 and shape[2] in (3, 4)
    if not one and not (len(shape) == 3 and shape[0] == shape[1] != shape[2]):
        return
    other = "one picture (H, W, C), save array[None]" if one else "(H, W, N), save array.transpose(2, 0, 1)"
    warnings.warn(
        f"{path}: {key}: {shape} is taken for {shape[0]} pictures of {shape[2]} x {shape[1]} pixels; if it is {other}",
        stacklevel=2,
    )


def are_inverted(pictures: Tensor, white: int) -> bool:
    """Whether most masks (N, 1, H, W) are bright along nine tenths of their border, as no object before a ground is."""
    some = to_floats(pictures[spread_rows(len(pictures), LOOKED_AT)], white) > 0.5
    border = torch.cat([some[:, 0, 0], some[:, 0, -1], some[:, 0, :, 0], some[:, 0, :, -1]], 1).float().mean(1)
    full = some.flatten(1).float().mean(1) > 0.99
    return bool(((border > 0.9) & ~full).float().mean() > 0.5)


def warn_of_inversion(path: Path, key: str) -> None:
    warnings.warn(
        f"{path}: {key}: most masks are bright along their border, so that they are taken for dark objects on a light "
        "ground; save 1 inside of objects and 0 outside",
        stacklevel=2,
    )


def masks_of(path: Path, key: str, found: Found, pictures: Tensor, options: ReadOptions) -> Found:
    """Return the masks of an array (N, C, H, W), framed if asked for or of another size.

    Raises:
        UserError: if none of them shows anything.
    """
    framing, (channels, *sides) = options.framing or AS_GIVEN, pictures.shape[1:]
    if framing == AS_GIVEN and channels == 1:
        white = white_of(pictures)
        if are_inverted(pictures, white):
            warn_of_inversion(path, key)
            pictures = white - pictures
    if framing == AS_GIVEN:
        found, rows = shown_rows(path, key, found, pictures, options.strict)
        pictures = pictures if rows is None else pictures[rows]
    if framing == AS_GIVEN and channels == 1 and (options.size is None or sides == [options.size] * 2):
        return found._replace(items=pictures)
    return _framed(
        path, found, pictures, ReadOptions(options.size or max(sides), framing=framing, strict=options.strict)
    )


def shown_rows(
    path: Path, key: str, found: Found, pictures: Tensor, strict: bool, inverted: bool = False
) -> tuple[Found, Tensor | None]:
    """Return the rows of masks (N, 1, H, W), or of cut-outs (N, 4, H, W), that show anything; None for all.

    Raises:
        UserError: if none does, or one does not and `strict` is given.
    """
    white = white_of(pictures)
    parts = (to_floats(part[:, -1], white) for part in chunks(pictures))
    shown = torch.cat([((part < 0.5) if inverted else (part > 0.5)).flatten(1).any(1) for part in parts])
    if not bool(shown.any()):
        raise UserError(f"{path}: {key}: no picture has anything above 0.5; silhouettes are 1 inside, 0 outside")
    return without(found, ~shown, "empty: no pixel reaches the threshold", strict)


def _framed(path: Path, found: Found, pictures: Tensor, options: ReadOptions) -> Found:
    """The pictures that can be framed, in 8 bits unless they are floats whose values are kept."""
    assert options.size is not None and options.framing is not None
    skipped, white, names = {}, white_of(pictures), names_of(found, len(pictures))
    exact = pictures.is_floating_point() and options.framing.threshold is None
    items = torch.empty(len(pictures), 1, options.size, options.size, dtype=torch.float32 if exact else torch.uint8)
    rows: list[int] = []
    for row, picture in enumerate(pictures):
        try:
            image = frame(to_floats(picture, white).movedim(0, 2).numpy(), options.size, options.framing).image
            items[len(rows)] = image if exact else to_bytes(image)
            rows.append(row)
        except UnusablePicture as reason:
            if options.strict:
                raise UserError(f"{path}, item {row}: {reason}; fix or remove it, or leave out --strict") from None
            skipped[names[row]] = str(reason)
    if not rows:
        raise UserError(f"{path}: none of the {len(pictures)} pictures can be used (item 0: {skipped[names[0]]})")
    return Found(
        items[: len(rows)],
        [names[row] for row in rows],
        None if found.latents is None else {name: value[rows] for name, value in found.latents.items()},
        (*found.skipped, *skipped.items()),
        str(path),
        1 if exact else 255,
    )
