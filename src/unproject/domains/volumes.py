"""Volumes: 3-D shapes, (N, X, Y, Z) in [0, 1]."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from .. import export
from ..data import Collection, read
from ..metrics import Finding, Score, one_minus_iou, picture_scores, shape_scores, silhouette_scores
from ..networks.generators import FINE_VOXELS
from ..ops.framing import unit_sized
from ..ops.layout import repeated_volumes
from ..ops.parts import face_connected, joined_parts, largest_part, number_parts
from ..projections.observation import Observation
from .domain import Domain, Exporter
from .evidence import Evidence, label_finding, likeness_finding, nearest
from .sides import side_findings
from .views import view_bins

CRUMB = 0.01
WHOLE, EMPTY = (0.5, 0.2), (0.05, 0.5)
"""Levels (doubtful, failed) of the shares of shapes in one piece, and of empty ones."""


@dataclass(frozen=True)
class Volumes(Domain):
    """Shapes as occupancy (N, X, Y, Z) in [0, 1], y up; turned about y by an unknown view's `azimuth`.

    Attributes:
        sized: samples have the size of the data's objects; without it, as after learning from cropped pictures, samples
            and references are scored at one size (`ops.unit_sized`).

    Examples:
        >>> import unproject as up
        >>> sorted(up.Volumes().exporters)
        ['gif', 'glb', 'npz', 'obj', 'ply', 'png', 'vox']
        >>> up.Volumes().checks(up.data.chairs(4, 32))["empty"].value
        0.0
    """

    name: ClassVar[str] = "volume"
    previewed: ClassVar[int] = 6
    scored: ClassVar[int] = 256
    written: ClassVar[str] = "glb"
    reads_silhouettes: ClassVar[bool] = True
    turned_by: ClassVar[str | None] = "azimuth"
    sized: bool = True

    def preview(self, x: Tensor) -> Image.Image:
        return export.contact_sheet(x, size=96)

    def empty(self, x: Tensor) -> Tensor:
        return (x <= 0.5).flatten(1).all(1)

    def largest_part(self, x: Tensor) -> Tensor:
        return face_connected(largest_part(joined_parts(x.float())))

    def repeated(self, x: Tensor, times: int) -> Tensor:
        return repeated_volumes(x, times) if times > 1 else x

    def scores(self, x: Tensor, reference: Tensor, seed: int = 0, turns: int | None = None) -> dict[str, Score]:
        if self.sized:
            return shape_scores(x, reference, bins=turns, seed=seed)
        found = shape_scores(unit_sized(x), unit_sized(reference.float()), bins=turns, seed=seed)
        return {name: replace(score, protocol=f"{score.protocol}, all at one size") for name, score in found.items()}

    def projection_scores(
        self, y: Tensor, reference: Tensor, seed: int = 0, silhouettes: bool = False
    ) -> dict[str, Score]:
        if reference.dim() != 4:
            return {}
        scores = silhouette_scores if silhouettes else picture_scores
        return scores(y, reference, seed=seed)

    def checks(self, x: Tensor, seed: int = 0) -> dict[str, Score]:
        solid = x.flatten(1).amax(1) > 0.5
        pieces = torch.tensor([count_pieces(volume) for volume in x[solid].numpy()]).float()
        n, filled = len(x), int(solid.sum())
        found: dict[str, Score] = {}
        if n > 1:
            distance = one_minus_iou(x[solid], x[solid]).sum().item() if filled > 1 else 0.0
            how = "mean 1-iou of two samples at 0.5, empty ones left out"
            found["diversity"] = Score(distance / max(filled * (filled - 1), 1), how, filled, seed)
        empty = 1 - filled / n
        whole = (pieces == 1).float().mean().item() if filled else 0.0
        return {
            **found,
            "in_one_piece": Score(
                whole, f"share of volumes whose parts of over {CRUMB:.0%} of the largest are one, at 0.5", filled, seed
            ),
            "empty": Score(empty, "share of volumes with nothing above 0.5", n, seed),
        }

    def findings(self, x: Tensor, seed: int = 0) -> list[Finding]:
        scores = self.checks(x, seed)
        whole, empty = scores["in_one_piece"], scores["empty"]
        pieces = f"{whole.value:.0%} of shapes are in one piece"
        removed = "train longer; export joins near parts and removes others"
        return [
            Finding("pieces", whole, *WHOLE, pieces, removed),
            Finding("empty", empty, *EMPTY, f"{empty.value:.0%} of shapes are empty", "train longer, or lower --rate"),
        ]

    def picture_distance(self, silhouettes: bool) -> Callable[[Tensor, Tensor], Tensor]:
        return one_minus_iou if silhouettes else super().picture_distance(silhouettes)

    def picture_findings(self, seen: Evidence, seed: int = 0) -> list[Finding]:
        distance = self.picture_distance(seen.silhouettes)
        found = super().picture_findings(seen, seed) + label_finding(distance(seen.real, seen.generated), seen, seed)
        if seen.silhouettes:
            found.append(likeness_finding(nearest(distance(seen.real, seen.others), seen.apart), len(seen.real), seed))
        return found

    def side_findings(self, observations: Sequence[Observation], shares: Tensor, known: bool) -> list[Finding]:
        return side_findings(observations, shares, known)

    def bins(self, observations: Sequence[Observation]) -> int:
        return view_bins(observations)

    def bytes_at(self, size: int, n: int) -> int:
        """Return the bytes that n volumes of another resolution take while they are made."""
        return 4 * (2 * n * size**3 + 8 * max(FINE_VOXELS, size**3))

    def read(self, path: Path, size: int) -> Collection:
        return read(path, size=size)

    def options_of(self, exporter: Exporter, largest_part: bool, numbers: Sequence[int] | None) -> dict[str, Any]:
        kept = {"largest": True} if largest_part else {"min_fraction": 0.0}
        options: dict[str, Any] = kept if exporter in export.MESHES else {}
        if numbers is not None and exporter in (*export.MESHES, export.vox):
            options["names"] = export.names_of(numbers)
        if numbers is not None and exporter is export.sheet_file:
            options["names"] = [str(number) for number in numbers]
        return options

    @property
    def exporters(self) -> Mapping[str, Exporter]:
        return {**super().exporters, **export.FORMATS}


def count_pieces(volume: np.ndarray) -> int:
    """Return how many parts, connected by corners, a volume (X, Y, Z) has at 0.5; crumbs do not count."""
    _, voxels = number_parts(volume > 0.5)
    return int((voxels > CRUMB * voxels.max()).sum())
