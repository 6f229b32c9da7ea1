"""Domain: what a generator makes: its arrays in files, preview picture, scores, gauge and exporters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from .._files import atomic_path
from .._types import UserError
from ..data import Collection
from ..data.readers.arrays import load_arrays
from ..export import Written, save_image
from ..metrics import Finding, Score, picture_scores
from ..metrics.picture_sets import root_mean_square
from ..projections.observation import Observation
from .evidence import MATCH, Evidence, match_finding, nearest, pairs, variety_finding
from .views import free_turns

Exporter = Callable[..., Written]
"""(samples, path, **options) → what was written."""


@dataclass(frozen=True)
class Domain(ABC):
    """What a generator makes. Subclass it, as a frozen dataclass, for a domain of your own: `preview` is enough.

    Attributes:
        name: of one sample, and the key of the samples in an .npz.
        previewed: how many samples a preview shows.
        scored: how many samples are scored (default of `unproject evaluate --n`).
        written: the format that samples are written in unless another is named.
        open_reflection: a projection of a sample in a view is also that of its mirror image in another view, so that
            data of unknown views leave a reflection open for each sample by itself.
        reads_silhouettes: `read` takes pictures for silhouettes.
        turned_by: the latent that turns a sample: raised by an angle it gives the projection of the sample turned by
            that angle, so that data of unknown views leave a turn of all samples open. None: no latent does.

    Examples:
        >>> import torch, unproject as up
        >>> from PIL import Image
        >>> class Signals(up.Domain):
        ...     name = "signal"
        ...     def preview(self, x):
        ...         return Image.fromarray((255 * x.clamp(0, 1)).byte().numpy())
        >>> Signals().preview(torch.rand(3, 8)).size
        (8, 3)
        >>> sorted(Signals().exporters)
        ['npz', 'png']
    """

    name: ClassVar[str] = "sample"
    previewed: ClassVar[int] = 16
    scored: ClassVar[int] = 256
    written: ClassVar[str] = "npz"
    open_reflection: ClassVar[bool] = False
    reads_silhouettes: ClassVar[bool] = False
    turned_by: ClassVar[str | None] = None

    @abstractmethod
    def preview(self, x: Tensor) -> Image.Image:
        """Draw samples x (N, ...) as one picture."""

    def empty(self, x: Tensor) -> Tensor:
        """Return in which of samples x (N, ...) nothing is to be seen, (N,) boolean."""
        return torch.zeros(len(x), dtype=torch.bool)

    def largest_part(self, x: Tensor) -> Tensor:
        """Return samples in one piece, without parts that float; those of a domain that has no parts as they are."""
        return x

    def bytes_at(self, size: int, n: int) -> int:
        """Estimate the most bytes that drawing n samples of another size takes, concatenation included; 0: unknown."""
        return 0

    def repeated(self, x: Tensor, times: int) -> Tensor:
        """Return samples (B, ...) each `times` in a row, to be projected, in the layout in memory that is fast."""
        return x.repeat_interleave(times, 0) if times > 1 else x

    def arrays(self, x: Tensor) -> dict[str, np.ndarray]:
        """Return samples as the arrays that `unproject sample` writes."""
        return {self.name: x.numpy()}

    def samples(self, arrays: Mapping[str, np.ndarray]) -> Tensor:
        """Return the samples of such arrays, (N, ...).

        Raises:
            UserError: if they are missing.
        """
        if self.name not in arrays:
            raise UserError(f"holds no array {self.name!r}; use a file that `unproject sample` wrote")
        return torch.as_tensor(arrays[self.name])

    def scores(self, x: Tensor, reference: Tensor, seed: int = 0, turns: int | None = None) -> dict[str, Score]:
        """Score samples against references (R, ...) of the same shape.

        Args:
            turns: how many turns the gauge has, of which the best is taken (default: samples are scored as they are).
        """
        return {}

    def comparable(self, reference: Tensor, x: Tensor) -> Tensor:
        """Return references with as many channels as samples x have, where samples may have more or fewer."""
        return reference

    def checks(self, x: Tensor, seed: int = 0) -> dict[str, Score]:
        """Score samples without a reference; of one alone there is nothing to say."""
        if len(x) < 2:
            return {}
        a, b = x[torch.arange(len(x)).roll(1)], x
        distance = (a - b).flatten(1).square().mean(1).sqrt().mean().item()
        spread = distance / max(x.std().item(), 1e-12)
        how = f"mean RMS difference of {len(x)} pairs of samples over the standard deviation of all values"
        return {"diversity": Score(spread, how, len(x), seed)}

    def projection_scores(
        self, y: Tensor, reference: Tensor, seed: int = 0, silhouettes: bool = False
    ) -> dict[str, Score]:
        """Score projections of samples (N, ...) against those of the data (M, ...); `silhouettes` if they are such.

        By root mean square differences, unless a domain knows better.
        """
        return picture_scores(y, reference, seed=seed)

    def findings(self, x: Tensor, seed: int = 0) -> list[Finding]:
        """Judge samples by themselves."""
        return []

    def picture_distance(self, silhouettes: bool) -> Callable[[Tensor, Tensor], Tensor]:
        """Return what gives the distances (A, B) of projections (A, ...) and (B, ...)."""
        return root_mean_square

    def picture_findings(self, seen: Evidence, seed: int = 0) -> list[Finding]:
        """Judge projections of samples by held-out pictures: `match` and `variety` of `evidence`."""
        d = self.picture_distance(seen.silhouettes)
        base = nearest(d(seen.real, seen.others), seen.apart)
        to_generated = d(seen.real, seen.generated).amin(1).mean().item()
        n = len(seen.generated)
        how = (
            f"distance of {len(seen.real)} pictures to the nearest of {n} generated, over training pictures {base:.3f}"
        )
        varied = pairs(d(seen.generated, seen.generated)) / max(pairs(d(seen.real, seen.real)), 1e-6)
        return [
            match_finding(to_generated / max(base, 1e-6), how, n, MATCH, seed),
            variety_finding(varied, f"mean distance of two of {n} generated pictures over that of real ones", n, seed),
        ]

    def side_findings(self, observations: Sequence[Observation], shares: Tensor, known: bool) -> list[Finding]:
        """Judge from where samples were seen.

        Args:
            shares: (K,) the share of pictures of each observation.
            known: whether views are known.
        """
        return []

    def open_findings(self, observations: Sequence[Observation], seed: int = 0) -> list[Finding]:
        """Judge what all observations of a run together leave open; nothing if it is not known or nothing is."""
        return []

    def turns(self, observations: Sequence[Observation], fixed: bool) -> int | None:
        """Return how many turns of a sample explain the same data; None if samples have one pose.

        Args:
            fixed: whether known views fix the pose.
        """
        if fixed or not self.turns_by(observations):
            return None
        return free_turns(observations, self.half_turn(observations))

    def turns_by(self, observations: Sequence[Observation]) -> bool:
        """Whether the first latent of these observations is the one that turns samples."""
        return self.turned_by is not None and observations[0].prior.names[:1] == (self.turned_by,)

    def bins(self, observations: Sequence[Observation]) -> int:
        """Return in how many bins the views of these observations are scored."""
        return len(observations)

    def half_turn(self, observations: Sequence[Observation]) -> bool:
        """Whether the views cover half a turn, the other half being mirror images of it."""
        return False

    def read(self, path: Path, size: int) -> Collection:
        """Read references from a path, by default samples that `unproject sample` wrote.

        Raises:
            UserError: if it holds none.
        """
        if path.suffix.lower() != ".npz":
            raise UserError(f"{path}: give an .npz of {self.name}s, as `unproject sample` writes it")
        arrays = load_arrays(path)
        try:
            return Collection(self.samples(arrays), source=str(path))
        except UserError as error:
            raise UserError(f"{path}: {error}") from error

    @property
    def exporters(self) -> Mapping[str, Exporter]:
        """Return format → exporter."""
        return {"npz": self.write_arrays, "png": partial(self.write_preview, suffix=".png")}

    def write(
        self,
        x: Tensor,
        to: str,
        path: str | PathLike[str],
        *,
        largest_part: bool = True,
        numbers: Sequence[int] | None = None,
        **options: Any,
    ) -> Written:
        """Write samples x (N, ...) in one of `exporters`.

        Args:
            to: the format.
            largest_part: leave out the parts that float.
            numbers: of the samples, where a format names them (default: from 0).
            options: of the exporter.
        """
        exporter = self.exporters[to]
        options |= self.options_of(exporter, largest_part, numbers)
        return exporter(self.largest_part(x) if largest_part else x, path, **options)

    def options_of(self, exporter: Exporter, largest_part: bool, numbers: Sequence[int] | None) -> dict[str, Any]:
        """Return the options by which an exporter leaves out parts that float, and names samples by their numbers."""
        return {}

    def write_arrays(self, x: Tensor, path: str | PathLike[str]) -> Written:
        """Write the arrays, at the path if it ends in .npz, else samples.npz in that folder."""
        path = Path(path) if Path(path).suffix.lower() == ".npz" else Path(path) / "samples.npz"
        arrays: dict[str, Any] = self.arrays(x)
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)
        return Written((path,))

    def write_preview(self, x: Tensor, path: str | PathLike[str], suffix: str = ".png", **options: Any) -> Written:
        """Write the preview, at the path if it ends in the suffix, else samples.png in that folder.

        `options` are those that `options_of` returns for it, of a domain whose `preview` takes any.
        """
        path = Path(path) if Path(path).suffix.lower() == suffix else Path(path) / f"samples{suffix}"
        save_image(self.preview(x, **options), path)
        return Written((path,))
