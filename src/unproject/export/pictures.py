"""Sheets of shaded views, sheets of silhouettes, and turntables that loop."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from unproject._types import UserError
from unproject.export._volumes import Written, as_array, as_batch, names_for, save, within
from unproject.export.rendering import ELEVATION, fitted_extent, render, solid
from unproject.ops.exposure import develop
from unproject.ops.maps import unpack_maps

# A quarter turn apart, none of them straight at a side: at 30° a chair shows its front, its side and its seat.
AZIMUTHS = tuple(math.radians(a) for a in (30, 120, 210, 300))
_LABEL = 16
_CAPTION = 24
_INK = (120, 120, 120)
_GREY = (128, 128, 128)
_LARGEST_GIF = 5_000_000
_QUALITY = {"JPEG": 92, "WEBP": 80}


def contact_sheet(
    volumes: ArrayLike,
    path: str | PathLike[str] | None = None,
    *,
    azimuths: Sequence[float] = AZIMUTHS,
    elevation: float = ELEVATION,
    size: int = 192,
    names: Sequence[str] | None = None,
) -> Image.Image:
    """Every shape (a row) seen from every azimuth (a column), all at one scale.

    Args:
        volumes: (N, X, Y, Z) or (X, Y, Z), a tensor or an array.
        path: where to write the picture too, by its suffix (.png).
        azimuths, elevation: of the cameras, radians.
        size: pixels of one view.
        names: labels of the shapes; default: their numbers.
    """
    batch = as_batch(volumes)
    extent = fitted_extent(batch, elevation)
    views = np.stack([[render(s, a, elevation, size, extent) for a in azimuths] for s in map(solid, batch)])
    shapes = [str(i) for i in range(len(batch))] if names is None else list(names_for(batch, names))
    degrees = [f"{math.degrees(a):.0f}°" for a in azimuths]
    return _kept(_labelled(_joined(views), size, degrees, shapes), path)


def gallery(
    volumes: ArrayLike,
    path: str | PathLike[str] | None = None,
    *,
    azimuth: float = AZIMUTHS[0],
    elevation: float = ELEVATION,
    size: int = 192,
    columns: int | None = None,
) -> Image.Image:
    """One view of every shape, in a grid: by default about as wide as high."""
    batch = as_batch(volumes)
    extent = fitted_extent(batch, elevation)
    views = np.stack([render(solid(v), azimuth, elevation, size, extent) for v in batch])
    return _kept(Image.fromarray(_joined(_in_grid(views, columns))), path)


def silhouette_sheet(
    images: ArrayLike, path: str | PathLike[str] | None = None, *, columns: int | None = None, scale: int = 1
) -> Image.Image:
    """(N, 1, H, W) or (N, H, W) silhouettes in [0, 1] in a grid, black on white with a thin line between them.

    Raises:
        UserError: another number of axes, or no images.
    """
    masks = as_array(images)
    if masks.ndim == 4 and masks.shape[1] == 1:
        masks = masks[:, 0]
    if masks.ndim != 3 or not masks.size:
        raise UserError(f"cannot show an array of shape {masks.shape}: silhouettes are (N, 1, H, W) with N at least 1")
    grey = (255 * (1 - np.clip(masks, 0, 1))).round().astype(np.uint8).repeat(scale, 1).repeat(scale, 2)
    framed = np.pad(grey, ((0, 0), (0, 1), (0, 1)), constant_values=210)
    return _kept(Image.fromarray(_joined(_in_grid(framed[..., None].repeat(3, -1), columns))), path, lossless=True)


def picture_sheet(
    pictures: Tensor, path: str | PathLike[str] | None = None, *, columns: int = 8, cell: int = 96
) -> Image.Image:
    """(N, 1 or 3, H, W) pictures in [0, 1] as they are, in a grid on grey, each fitted into a cell of `cell` pixels.

    Raises:
        UserError: another number of axes or channels, or no pictures.
    """
    if pictures.dim() != 4 or pictures.shape[1] not in (1, 3) or not pictures.numel():
        raise UserError(f"cannot show an array of shape {tuple(pictures.shape)}: pictures are (N, 1 or 3, H, W)")
    columns = min(columns, len(pictures))
    sheet = Image.new("RGB", (columns * cell, math.ceil(len(pictures) / columns) * cell), _GREY)
    _paste(sheet, pictures, columns, cell, 0)
    return _kept(sheet, path)


def _paste(sheet: Image.Image, pictures: Tensor, columns: int, cell: int, top: int) -> None:
    """Put pictures (N, 1 or 3, H, W) in [0, 1] into the cells of a sheet, from a row of pixels on."""
    pixels = pictures.detach().cpu().clamp(0, 1).mul(255).round().byte().expand(-1, 3, -1, -1).movedim(1, 3).numpy()
    scale = (cell - 4) / max(pixels.shape[1:3])
    height, width = (max(round(side * scale), 1) for side in pixels.shape[1:3])
    for k, picture in enumerate(pixels):
        resampling = Image.Resampling.BOX if scale < 1 else Image.Resampling.NEAREST
        place = (k % columns * cell + 2, top + k // columns * cell + 2)
        sheet.paste(Image.fromarray(picture).resize((width, height), resampling), place)


def grouped_sheet(
    groups: Mapping[str, Tensor], path: str | PathLike[str] | None = None, *, columns: int = 8
) -> Image.Image:
    """Groups of pictures (N, 1 or 3, H, W) in [0, 1] below one another, each under its caption, on grey.

    Pixels of small pictures are doubled, and doubled again, until a picture is over 100 pixels wide; large ones are
    reduced to 256.
    """
    side = max(max(pictures.shape[2:]) for pictures in groups.values())
    cell = min(side * 2 ** max(0, math.ceil(math.log2(100 / side))), 256) + 4
    rows = [math.ceil(len(pictures) / columns) for pictures in groups.values()]
    sheet = Image.new("RGB", (columns * cell, sum(rows) * cell + len(groups) * _CAPTION), _GREY)
    draw, font, top = ImageDraw.Draw(sheet), ImageFont.load_default(size=13), 0
    for (caption, pictures), count in zip(groups.items(), rows, strict=True):
        draw.text((4, top + _CAPTION / 2), caption, fill=(255, 255, 255), font=font, anchor="lm")
        _paste(sheet, pictures, columns, cell, top + _CAPTION)
        top += _CAPTION + count * cell
    return _kept(sheet, path)


def graphs(lines: Tensor) -> Tensor:
    """Line integrals (N, 1, D) as pictures (N, 1, D, D) of their graphs, each as high as its largest value."""
    count = lines.shape[2]
    heights = lines / lines.amax(2, keepdim=True).clamp_min(1e-12)
    levels = 1 - (torch.arange(count, device=lines.device)[:, None] + 0.5) / count
    return (heights[:, :, None] > levels).float()


def map_picture(name: str, part: Tensor) -> Tensor:
    """Return a map (N, C, H, W) of materials as a picture: albedo developed with gamma 2.2, a normal n as (n + 1)/2."""
    return develop(part) if name in ("diffuse", "specular") else part / 2 + 0.5 if name == "normal" else part


def material_sheet(
    maps: Tensor,
    pictures: Mapping[str, Tensor],
    path: str | PathLike[str] | None = None,
    *,
    scale: int = 1,
    names: Sequence[str] | None = None,
) -> Image.Image:
    """A row a material: its diffuse, specular, roughness and normal map, and pictures name → (N, 3, H, W) of it.

    Args:
        maps: (N, 8 or 10, H, W).
        pictures: of each material.
        path: where to write the sheet too, by its suffix (.png).
        scale: how many times as large as a texel a pixel is.
        names: of the materials, at the left; default: their numbers.
    """
    columns = {name: map_picture(name, part) for name, part in unpack_maps(maps.detach().cpu()).items()}
    columns |= {name: picture.detach().cpu() for name, picture in pictures.items()}
    stacked = torch.stack([column.expand(-1, 3, -1, -1) for column in columns.values()], 1)
    cells = stacked.permute(0, 1, 3, 4, 2).clamp(0, 1).mul(255).round().byte().numpy()
    cells = cells.repeat(scale, 2).repeat(scale, 3)
    rows = [str(i) for i in range(len(maps))] if names is None else list(names_for(maps, names))
    return _kept(_labelled(_joined(cells), cells.shape[3], [*columns], rows, cells.shape[2]), path)


def turntable(
    volumes: ArrayLike,
    path: str | PathLike[str],
    *,
    frames: int = 36,
    elevation: float = ELEVATION,
    size: int = 128,
    columns: int | None = None,
    track: Callable[[range], Iterable[int]] = iter,
) -> Written:
    """A GIF that loops: the shapes in a grid while the camera goes round them once, at most 5 MB.

    Args:
        frames: in one round, which takes about three seconds.
        size: pixels of one shape; smaller if the file would be too large otherwise.
        track: wraps the range of frames, for a progress bar.
    """
    if frames < 2:
        raise UserError(f"a turntable of {frames} frames does not turn: use at least 2")
    batch = as_batch(volumes)
    extent = fitted_extent(batch, elevation)
    shapes = [solid(v) for v in batch]
    turns = [
        _joined(
            _in_grid(np.stack([render(s, 2 * math.pi * i / frames, elevation, size, extent) for s in shapes]), columns)
        )
        for i in track(range(frames))
    ]
    return Written((save(Path(path), _small_gif(turns)),))


def _small_gif(pictures: list[np.ndarray]) -> bytes:
    """The frames as a GIF, shrunk until it fits."""
    images = [Image.fromarray(p) for p in pictures]
    content = _gif(images)
    while len(content) > _LARGEST_GIF:
        shrink = 0.9 * math.sqrt(_LARGEST_GIF / len(content))
        width, height = (max(1, int(n * shrink)) for n in images[0].size)
        images = [image.resize((width, height), Image.Resampling.LANCZOS) for image in images]
        content = _gif(images)
    return content


def _gif(images: list[Image.Image]) -> bytes:
    """One palette for all frames, fitted to a few of them, and no dithering: both keep the file small."""
    several = images[:: max(1, len(images) // 4)]
    palette = Image.fromarray(np.concatenate([np.asarray(i) for i in several])).quantize(64, Image.Quantize.MEDIANCUT)
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    # Pillow does not tell 252 from 255 when it looks colours up, and a frame that is not quite white shows on a page.
    colours[(colours >= 248).all(1)] = 255
    palette.putpalette(colours.ravel().tolist())
    quantized = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    content = io.BytesIO()
    duration = max(20, round(3000 / len(images) / 10) * 10)
    quantized[0].save(
        content, "GIF", save_all=True, append_images=quantized[1:], loop=0, duration=duration, optimize=False
    )
    return content.getvalue()


def _in_grid(pictures: np.ndarray, columns: int | None) -> np.ndarray:
    """(N, H, W, 3) → (R, C, H, W, 3), filled up with white."""
    n = len(pictures)
    columns = min(n, math.ceil(math.sqrt(n)) if columns is None else max(1, columns))
    missing = -n % columns
    filled = np.pad(pictures, ((0, missing), (0, 0), (0, 0), (0, 0)), constant_values=255)
    return filled.reshape(-1, columns, *pictures.shape[1:])


def _joined(cells: np.ndarray) -> np.ndarray:
    """(R, C, H, W, 3) → (R·H, C·W, 3)."""
    rows, columns, height, width, channels = cells.shape
    return cells.swapaxes(1, 2).reshape(rows * height, columns * width, channels)


def _labelled(
    picture: np.ndarray, size: int, columns: Sequence[str], rows: Sequence[str], beside: int = 0
) -> Image.Image:
    """The picture under a thin line of column labels, each row's label in its upper left corner.

    Rows `beside` pixels high that have no white corner have their labels in a margin at the left.
    """
    font = ImageFont.load_default(size=11)
    margin = math.ceil(max(map(font.getlength, rows))) + 8 if beside else 0
    sheet = Image.fromarray(np.pad(picture, ((_LABEL, 0), (margin, 0), (0, 0)), constant_values=255))
    draw = ImageDraw.Draw(sheet)
    for i, label in enumerate(columns):
        draw.text((margin + (i + 0.5) * size, _LABEL / 2), label, fill=_INK, font=font, anchor="mm")
    for i, label in enumerate(rows):
        draw.text((4, _LABEL + i * (beside or size) + 3), label, fill=_INK, font=font)
    return sheet


def save_image(picture: Image.Image, path: str | PathLike[str]) -> None:
    """Write a picture by the suffix of its path, whole or not at all."""
    _kept(picture, path)


def _kept(picture: Image.Image, path: str | PathLike[str] | None, lossless: bool = False) -> Image.Image:
    """Save the picture, if a path is given. WebP is smaller lossless where there are few grey levels."""
    if path is not None:
        content, name = io.BytesIO(), _format(Path(path))
        picture.save(content, name, quality=_QUALITY.get(name, 100), lossless=lossless)
        save(Path(path), content.getvalue())
    return picture


def _format(path: Path) -> str:
    suffixes = {suffix: kind for suffix, kind in Image.registered_extensions().items() if kind in Image.SAVE}
    if path.suffix.lower() not in suffixes:
        raise UserError(f"{path}: pictures are written by their suffix: use .png")
    return suffixes[path.suffix.lower()]


def sheet_file(volumes: ArrayLike, path: str | PathLike[str], **options: Any) -> Written:
    """`contact_sheet` as a format of `write`: at the path if it ends in .png, else contact_sheet.png in that folder.

    Images (N, 1, H, W) in [0, 1] are shown as they are, 1 white, in a grid.
    """
    final = within(Path(path), ".png", "contact_sheet.png")
    shape = np.shape(volumes)
    if len(shape) == 4 and shape[1] == 1:
        silhouette_sheet(1 - as_array(volumes).clip(0, 1), final, scale=4, **options)  # silhouettes are dark on light
    else:
        contact_sheet(volumes, final, **options)
    return Written((final,))


def turntable_file(volumes: ArrayLike, path: str | PathLike[str], **options: Any) -> Written:
    """`turntable` as a format of `write`: at the path if it ends in .gif, else turntable.gif in that folder."""
    return turntable(volumes, within(Path(path), ".gif", "turntable.gif"), **options)
