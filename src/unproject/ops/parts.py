"""Parts of volumes: connected sets of voxels above a level; voxels that share a corner are connected."""

from __future__ import annotations

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from .._types import UserError

_CORNERS = np.ones((3, 3, 3))
_NEIGHBOURS = np.argwhere(_CORNERS) - 1
_BY_FACES = _NEIGHBOURS[np.abs(_NEIGHBOURS).sum(1) == 1]
_ROUNDING = 1e-5  # of costs: mirror images of a path differ by less


def number_parts(occupied: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number the parts of a mask (X, Y, Z) 1, 2, ...; return each voxel's number, 0 outside, and voxels by number."""
    numbers, _ = ndimage.label(occupied, _CORNERS)  # pyright: ignore[reportGeneralTypeIssues]
    voxels = np.bincount(numbers.ravel())
    voxels[0] = 0
    return numbers, voxels


def largest_part(x: Tensor, level: float = 0.5) -> Tensor:
    """Remove all parts but the largest, with the soft voxels around them.

    A voxel is set to zero if it lies nearer to another part than to the largest, by the chessboard distance
    max(|dx|, |dy|, |dz|). The soft voxels that adjoin the largest part stay, and with them its iso-surface; volumes in
    one piece stay as they are. Of several largest parts the first is kept.

    Args:
        x: (..., X, Y, Z).
        level: parts are connected sets of voxels above it.

    Raises:
        UserError: for less than three axes.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(1, 8, 8, 8)
        >>> x[:, :4, :4, :4], x[:, 6, 6, 6] = 1, 1  # a block of 64 voxels, and a crumb
        >>> up.ops.largest_part(x).sum()
        tensor(64.)
    """
    keep = torch.ones(x.shape, dtype=torch.bool, device=x.device)
    for kept, occupied in zip(_each(keep), _each((x > level).cpu()), strict=True):
        numbers, voxels = number_parts(occupied.numpy())
        if len(voxels) > 2:
            other = (numbers > 0) & (numbers != voxels.argmax())
            kept.copy_(torch.from_numpy(_distance((numbers > 0) & ~other) <= _distance(other)))
    return x.masked_fill(~keep, 0)


def joined_parts(x: Tensor, level: float = 0.5, low: float = 0.02, gap: int | None = None) -> Tensor:
    """Join the largest part to parts near it, where what lies between is not empty.

    A path from the largest part to another costs Σ (2 - p) over the voxels between, all of which are above `low`. The
    paths of least cost are raised to halfway between the level and 1, if they cost at most 2 `gap`, and 2 for each
    voxel of the other part: legs may be far, crumbs only near. Then the same with the larger part that there is now,
    until no more are joined. All other voxels stay as they are.

    A silhouette is opaque where many thin layers lie behind one another: 32 voxels of 0.02 absorb 72 % at a density of
    2. So legs and backs may be seen and yet be below the level for a few voxels. To remove what is beyond such a gap
    would take the back from a chair. All paths that cost the same are raised, so that what is symmetric stays so.

    Args:
        x: (..., X, Y, Z), in [0, 1].
        level: parts are connected sets of voxels above it.
        low: what is above it counts as not empty.
        gap: so many voxels of nearly nothing may lie between (default: an eighth of the longest side, and at least
            four).

    Raises:
        UserError: for less than three axes.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.tensor([1, 1, 1, 0.1, 0.3, 1, 1, 0, 1]).reshape(1, 9, 1, 1)
        >>> up.ops.joined_parts(x).flatten()
        tensor([1.0000, 1.0000, 1.0000, 0.7500, 0.7500, 1.0000, 1.0000, 0.0000, 1.0000])
    """
    gap = max(4, max(x.shape[-3:], default=0) // 8) if gap is None else gap
    raised, values = torch.zeros(x.shape, dtype=torch.bool), _each(x.detach().cpu().float()).numpy()
    for found, occupied, p in zip(_each(raised).numpy(), _each((x > level).cpu()).numpy(), values, strict=True):
        step = np.where(occupied | (p > low), 2 - p.clip(max=1).astype(np.float64), -1)  # negative: impassable
        while (bridges := _bridges(occupied, step, gap)).any():
            found |= bridges
            occupied |= bridges
    return x.masked_fill(raised.to(x.device), (1 + level) / 2)


def _bridges(occupied: np.ndarray, step: np.ndarray, gap: int) -> np.ndarray:
    """Find the voxels of all paths of least cost that join the largest part to others, `step` being that of a voxel."""
    numbers, voxels = number_parts(occupied)
    found = np.zeros_like(occupied)
    if len(voxels) > 2:
        from skimage.graph import MCP  # here, since it takes a third of a second to import

        largest = numbers == voxels.argmax()
        step = np.where(largest, 0, step)
        costs, _ = MCP(step).find_costs(np.argwhere(largest)[:1])
        before = costs - step  # of paths up to a voxel
        others = np.setdiff1d(np.flatnonzero(voxels), voxels.argmax())
        for part, least in zip(others, ndimage.minimum(before, numbers, others), strict=True):
            if least <= 2 * min(gap, voxels[part]):
                ends = np.argwhere((numbers == part) & (before <= least + _ROUNDING))
                found |= _backwards(costs, step, ends, _NEIGHBOURS)
    return found & ~occupied


def _backwards(costs: np.ndarray, step: np.ndarray, ends: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    """Find the voxels of all paths of least cost to voxels `ends` (N, 3), these too, up to where steps cost nothing.

    Args:
        costs, step: (X, Y, Z), of the cheapest path to each voxel, its own step among them, and of that step.
        ends: indices (N, 3).
        neighbours: offsets (K, 3) of the voxels that may come before.
    """
    found = np.zeros(step.shape, dtype=bool)
    while len(ends):
        at = tuple(ends.T)
        found[at] = True
        least = (costs[at] - step[at]).repeat(len(neighbours))
        before = (ends[:, None] + neighbours).reshape(-1, 3)
        inside = ((before >= 0) & (before < step.shape)).all(1)
        before, least = before[inside], least[inside]
        at = tuple(before.T)
        ends = np.unique(before[(step[at] > 0) & (costs[at] <= least + _ROUNDING) & ~found[at]], axis=0)
    return found


def face_connected(x: Tensor, level: float = 0.5) -> Tensor:
    """Join by faces what touches in edges or corners alone, since surfaces part there and meshes lose what is beyond.

    In each part, pieces that are connected by faces are joined to the largest of them, along paths of faces with the
    least Σ (2 - p) over voxels that adjoin the part: those of all such paths are raised to halfway between the level
    and 1. All other voxels stay as they are.

    Args:
        x: (..., X, Y, Z).
        level: parts are connected sets of voxels above it.

    Raises:
        UserError: for less than three axes.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.tensor([[1, 1, 0.2], [0.1, 0.3, 1]])[None, :, :, None]
        >>> up.ops.face_connected(x)[0, ..., 0]
        tensor([[1.0000, 1.0000, 0.2000],
                [0.1000, 0.7500, 1.0000]])
    """
    raised, values = torch.zeros(x.shape, dtype=torch.bool), _each(x.detach().cpu().float()).numpy()
    for found, occupied, p in zip(_each(raised).numpy(), _each((x > level).cpu()).numpy(), values, strict=True):
        while (paths := _paths(occupied, p)).any():  # which may touch another part
            found |= paths
            occupied |= paths
    return x.masked_fill(raised.to(x.device), (1 + level) / 2)


def _paths(occupied: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Find the voxels of all paths of least cost that join the pieces of each part by faces."""
    parts, _ = number_parts(occupied)
    pieces, _ = ndimage.label(occupied)  # pyright: ignore[reportGeneralTypeIssues]
    found = np.zeros_like(occupied)
    for part, box in enumerate(ndimage.find_objects(parts), 1):
        box = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in box)
        inside = parts[box] == part
        voxels = np.bincount(pieces[box][inside])
        if np.count_nonzero(voxels) > 1:
            from skimage.graph import MCP  # here, since it takes a third of a second to import

            largest = inside & (pieces[box] == voxels.argmax())
            step = np.where(inside, 0, np.where(grown(inside) & ~occupied[box], 2 - p[box].astype(np.float64), -1))
            costs, _ = MCP(step, fully_connected=False).find_costs(np.argwhere(largest)[:1])
            # Paths through other pieces are those of these pieces, and from these on.
            found[box] |= _backwards(costs, step, np.argwhere(inside & ~largest), _BY_FACES)
    return found & ~occupied


def _each(x: Tensor) -> Tensor:
    """Return (..., X, Y, Z) as (N, X, Y, Z), a view if x is contiguous; without voxels there are no volumes.

    Raises:
        UserError: for less than three axes.
    """
    if x.dim() < 3:
        raise UserError(f"an array of shape {tuple(x.shape)} holds no volumes: give (N, X, Y, Z)")
    return x.reshape(-1, *x.shape[-3:]) if x.numel() else x.new_empty(0, 1, 1, 1)


def _distance(mask: np.ndarray) -> np.ndarray:
    """Return the chessboard distance of each voxel to a mask that is not empty."""
    found: np.ndarray = ndimage.distance_transform_cdt(~mask, "chessboard")  # pyright: ignore[reportAssignmentType]
    return found


def floating_parts(x: Tensor, level: float = 0.5) -> tuple[Tensor, Tensor]:
    """Find the parts that float, and the gaps between the largest part and those near it.

    A part floats if gaps of more than two voxels separate it from the largest part, in one step or from part to part.
    Its voxels are found with those that adjoin it, whatever their value. A gap is what lies between the largest part
    and another at most two voxels away: voxels outside both whose chessboard distances to them sum to 3 at most.

    Args:
        x: (B, X, Y, Z).
        level: parts are connected sets of voxels above it.

    Returns:
        Floating parts, and gaps, both (B, X, Y, Z) and bool.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(1, 10, 1, 1)
        >>> x[:, [0, 1, 3, 9]] = 1  # two voxels, one behind a gap, and one that floats
        >>> floating, gaps = up.ops.floating_parts(x)
        >>> floating.flatten().nonzero().flatten().tolist(), gaps.flatten().nonzero().flatten().tolist()
        ([8, 9], [2])
    """
    found = torch.zeros(2, *x.shape, dtype=torch.bool)
    for i, occupied in enumerate((x.detach() > level).cpu().numpy()):
        numbers, voxels = number_parts(occupied)
        if len(voxels) > 2:
            largest = numbers == voxels.argmax()
            found[0, i] = torch.from_numpy(_far(occupied, largest))
            found[1, i] = torch.from_numpy(_between(largest, occupied & ~largest))
    floating, gaps = found.to(x.device)
    return floating, gaps


def _far(occupied: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """Find the parts, each grown by a voxel, that are then not connected to the largest."""
    numbers, _ = number_parts(grown(occupied))
    return (numbers > 0) & (numbers != numbers[largest][0])


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Find the voxels outside two masks whose distances to them sum to 3 at most."""
    near_a, near_b = grown(a), grown(b)
    return ((near_a & grown(near_b)) | (grown(near_a) & near_b)) & ~a & ~b


def grown(mask: np.ndarray) -> np.ndarray:
    """Add the 26 neighbours of each voxel of a mask."""
    for axis in range(3):
        before = mask.swapaxes(0, axis)
        grown = before.copy()
        grown[1:] |= before[:-1]
        grown[:-1] |= before[1:]
        mask = grown.swapaxes(0, axis)
    return mask
