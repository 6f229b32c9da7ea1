"""Light probes: environments as lat-long maps of linear radiance.

A probe L is (3, H, W). Row i spans the polar angles π i/H … π (i+1)/H from the surface normal z, which is the top row;
column j the azimuths 2π j/W … 2π (j+1)/W from x towards y. A texel covers the solid angle

    Ω_i = 2π/W · (cos(π i/H) - cos(π (i+1)/H)),        Σ_ij Ω_i = 4π

and a change of size keeps ∫ L dΩ over any part of the sphere that is made of whole texels before and after.

Panoramas have the sky in their top row, so a probe read from one lights a surface that lies on the ground.
"""

from __future__ import annotations

import math
import warnings
from os import PathLike
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..._files import files_with
from ..._pictures import read_stored
from ..._types import UserError
from ...ops.resampling import interval_shares
from .arrays import load_arrays
from .found import Found
from .stored import shapes_of

SUFFIXES = (".hdr", ".exr", ".npy")
NOISE = 1e-3  # share of the maximum below zero that filters and lossy compression leave: cut at 0
LOWEST_ASPECT, HIGHEST_ASPECT = 1.5, 2.5


def read_probe(path: str | PathLike[str], height: int | None = None) -> Tensor:
    """A probe (3, H, W) float32, radiance as stored, from .hdr, .exr or .npy (H, W, 3).

    Alpha is dropped and a single channel repeated. With a height it is resampled to (3, height, 2 height).

    Raises:
        UserError: for a file that is missing or damaged, or whose values cannot be an environment's radiance.
    """
    path, height = Path(path), _checked_height(height)
    probe = checked_radiance(_stored_pixels(path), str(path))
    return probe if height is None else resample_probe(probe, height)


def read_probes(
    path: str | PathLike[str], height: int | None = None, *, strict: bool = False
) -> tuple[Tensor, list[str]]:
    """Probes (K, 3, H, W) and their names, from a file, a folder or an .npz, as `find_probes` finds them.

    One that cannot be used is skipped with a warning that names it and says why.

    Raises:
        UserError: as `find_probes`.
    """
    found = find_probes(path, height, strict)
    if found.skipped:
        skipped, total = len(found.skipped), len(found.skipped) + len(found.items)
        warnings.warn(f"{skipped} of {total} light probes skipped, the first: {found.skipped[0][1]}", stacklevel=2)
    return found.whole, list(found.names or ())


def find_probes(path: str | PathLike[str], height: int | None = None, strict: bool = False) -> Found:
    """Read probes (K, 3, H, W) with their names, and which were skipped and why.

    A folder is read recursively in the order of names; an .npz holds `probes` (K, H, W, 3) and, if they have any,
    `names`. Without a height, probes of one size stay as they are and others take the lowest of their heights.

    Raises:
        UserError: if there is no probe, none that can be used, or with `strict` one that cannot.
    """
    path, height = Path(path), _checked_height(height)
    sources = _array_items(path) if path.suffix.lower() == ".npz" else _files(path)
    found: dict[str, Tensor] = {}
    skipped: dict[str, str] = {}
    for name, source in sources.items():
        try:
            pixels = _stored_pixels(source) if isinstance(source, Path) else source
            probe = checked_radiance(pixels, str(source) if isinstance(source, Path) else f"{path}, probe {name}")
        except UserError as error:
            if strict or len(sources) == 1:
                raise
            skipped[name] = str(error)
        else:
            found[name] = probe if height is None else resample_probe(probe, height)
    if not found:
        raise UserError(f"{path}: none of the {len(skipped)} light probes can be used ({next(iter(skipped.values()))})")
    return Found(_stacked(list(found.values())), tuple(found), None, tuple(skipped.items()), str(path))


def _stacked(probes: list[Tensor]) -> Tensor:
    if len({probe.shape for probe in probes}) > 1:
        lowest = min(probe.shape[1] for probe in probes)
        probes = [resample_probe(probe, lowest) for probe in probes]
    return torch.stack(probes)


def _checked_height(height: int | None) -> int | None:
    if height is not None and not 2 <= height <= 8192:
        raise UserError(f"light probe: a height of {height} rows makes no sense; give 2 to 8192")
    return height


def _files(path: Path) -> dict[str, Path]:
    """Name → file, of a file or of a folder's probes; hidden files are none."""
    if not path.is_dir():
        return {path.name: path}
    named = {file.relative_to(path).as_posix(): file for file in files_with(path, SUFFIXES)}
    if not named:
        raise UserError(f"{path}: holds no light probe; put {', '.join(SUFFIXES)} files there, or name an .npz")
    return named


def _array_items(path: Path) -> dict[str, np.ndarray]:
    """Name → pixels (H, W, C), of an .npz."""
    arrays = load_arrays(path)
    probes = arrays.get("probes")
    if probes is None or probes.ndim not in (3, 4) or len(probes) == 0:
        held = ", ".join(f"{key} {shape}" for key, shape in shapes_of(arrays).items())
        raise UserError(f"{path}: holds {held or 'nothing'}; save the light probes as `probes` (K, H, W, 3)")
    probes = probes[None] if probes.ndim == 3 else probes
    names = arrays.get("names", np.array([f"{i:05d}" for i in range(len(probes))]))
    if names.shape != (len(probes),) or len(set(names.tolist())) != len(probes):
        raise UserError(f"{path}: names {names.shape} for {len(probes)} probes; give each a name of its own, or none")
    return {str(name): pixels for name, pixels in zip(names.tolist(), probes)}


def _stored_pixels(path: Path) -> np.ndarray:
    if path.is_dir() or (path.suffix.lower() == ".npz" and path.exists()):
        raise UserError(
            f"{path}: may hold several light probes where one is meant; name one {', '.join(SUFFIXES)} file"
        )
    if path.suffix.lower() not in SUFFIXES and path.is_file():
        raise UserError(
            f"{path}: not linear radiance: pictures of 8 or 16 bits are made for screens; give the light probe as "
            f"{', '.join(SUFFIXES)}"
        )
    if path.suffix.lower() == ".npy":
        return load_arrays(path)["array"]
    picture = read_stored(path)
    if picture.stored not in ("half", "float", "double"):
        raise UserError(f"{path}: holds {picture.stored} values, not linear radiance; give one stored as floats")
    return picture.pixels


def checked_radiance(pixels: np.ndarray, source: str) -> Tensor:
    """Pixels (H, W) or (H, W, C) of 1 to 4 channels (2 and 4: the last is alpha) as a probe (3, H, W) float32.

    Raises:
        UserError: naming `source`, for integers, another shape, values that are NaN, infinite or negative, or none lit.
    """
    if pixels.dtype.kind != "f":
        raise UserError(f"{source}: holds {pixels.dtype} values, not linear radiance; save it as float32")
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 2, 3, 4):
        raise UserError(f"{source}: is of shape {pixels.shape}; a light probe is (H, W, 3) with W = 2 H")
    height, width, channels = pixels.shape
    if height < 2 or not LOWEST_ASPECT <= width / height <= HIGHEST_ASPECT:
        raise UserError(
            f"{source}: is {width} × {height} pixels; a lat-long map is twice as wide as high: convert cube maps and "
            "mirror balls, and give whole panoramas"
        )
    with np.errstate(over="ignore"):
        radiance = torch.from_numpy(np.moveaxis(pixels, 2, 0).astype(np.float32, order="C"))
    radiance = _lit(radiance[: 3 if channels > 2 else 1], source)
    return radiance.expand(3, -1, -1).contiguous()


def _lit(radiance: Tensor, source: str) -> Tensor:
    if not bool(radiance.isfinite().all()):
        count = int((~radiance.isfinite()).sum())
        raise UserError(f"{source}: has {count} values that are NaN, infinite or over float32; replace them")
    low, high = radiance.min().item(), radiance.max().item()
    if high <= 0 and low >= 0:
        raise UserError(f"{source}: is black everywhere; give a light probe with light in it")
    if low < -NOISE * max(high, 0):
        raise UserError(f"{source}: radiance is negative ({low:.3g}); give values of at least 0, before any offset")
    return radiance.clamp(min=0)


def resample_probe(probe: Tensor, height: int) -> Tensor:
    """Return a probe (..., H, W) at (..., height, 2 height); keeps ∫ L dΩ.

    L'_ij = Σ_hw R_ih C_jw L_hw, where R_ih is the share of target row i's interval of cos θ that lies in source row h,
    and C_jw the share of target column j's interval of φ that lies in source column w.

    Raises:
        UserError: for a height below 1.
    """
    if height < 1:
        raise UserError(f"light probe: cannot have {height} rows; give at least 1")
    if probe.shape[-2:] == (height, 2 * height):
        return probe
    rows = interval_shares(polar_edges(probe.shape[-2]), polar_edges(height)).to(probe.device)
    columns = interval_shares(azimuth_edges(probe.shape[-1]), azimuth_edges(2 * height)).to(probe.device)
    return torch.einsum("ih,...hw,jw->...ij", rows, probe.double(), columns).to(probe.dtype)


def polar_edges(height: int) -> Tensor:
    """(height + 1,) rising edges of the rows in -cos θ, from -1 at the normal to 1, float64."""
    return -torch.cos(torch.linspace(0, math.pi, height + 1, dtype=torch.float64))


def azimuth_edges(width: int) -> Tensor:
    """(width + 1,) edges of the columns in φ, from 0 to 2π, float64."""
    return torch.linspace(0, 2 * math.pi, width + 1, dtype=torch.float64)


def directions(height: int, width: int) -> Tensor:
    """(3, height, width) unit vectors towards the texels' centres, (sin θ cos φ, sin θ sin φ, cos θ), float64."""
    theta = (torch.arange(height, dtype=torch.float64)[:, None] + 0.5) * (math.pi / height)
    phi = (torch.arange(width, dtype=torch.float64) + 0.5) * (2 * math.pi / width)
    x, y = torch.sin(theta) * torch.cos(phi), torch.sin(theta) * torch.sin(phi)
    return torch.stack([x, y, torch.cos(theta).expand(-1, width)])
