"""Collection: the items that an observation is learned from, with their names and known latents.

Collection.silhouettes("masks/")             pictures of objects: thresholded, cropped, centred (`readers/framing.py`)
Collection.images("scans/depth")             pictures as they are: grey, neither thresholded nor cropped
Collection.lines("scans.npz")                line integrals, an array (N, D) named `lines`
Collection.volumes("chairs.npz:chair")       volumes: .npz of voxels, .binvox, meshes, or a folder of them
Collection.materials("wood/")                material maps: folders of textures, or an .npz of maps
Collection.photographs("wood/", "top", 64)   pictures of materials, one sub-folder for each observation
Collection(tensor)                           items in memory
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor
from typing_extensions import Self

from .._types import UserError
from .items import check_columns, checked, native, tensor_of
from .lazy import Lazy, Rows
from .readers.arrays import read_arrays
from .readers.found import Found, to_floats, white_of
from .readers.framing import Framing
from .readers.options import ReadOptions
from .readers.paths import find
from .readers.photographs import find_photographs
from .readers.shapes import UpAxis, find_volumes
from .readers.textures import Convention, find_materials
from .splitting import split_rows

PathLike = str | os.PathLike[str]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Collection:
    """N items of one shape. They stay as they came, and `batch` converts them.

    >>> masks = Collection(torch.tensor([[[[0, 255]]], [[[255, 255]]]], dtype=torch.uint8), names=["left", "right"])
    >>> masks
    Collection(2 items of 1 x 1 x 2 from memory, unknown views)
    >>> masks.batch([1])
    tensor([[[[1., 1.]]]])

    Attributes:
        stored: (N, C, H, W) pictures, (N, X, Y, Z) volumes or (N, 1, D) line integrals; uint8 or float32. Pictures of
            a .npy file, or of a large .npz that is not compressed, stay in the file until a batch asks for them.
        names: one name for each item.
        latents: the known views, name → (N,) float32 (angles in radians); None if unknown.
        skipped: (name, reason) of each file that was found and not used.
        source: where the items come from, for messages.
        white: the stored value that stands for 1.
    """

    stored: Tensor | Lazy
    names: tuple[str, ...]
    latents: dict[str, Tensor] | None
    skipped: tuple[tuple[str, str], ...]
    source: str
    white: int

    def __init__(
        self,
        items: Any,
        *,
        names: Sequence[str] | None = None,
        latents: Mapping[str, Any] | None = None,
        skipped: Sequence[tuple[str, str]] = (),
        source: str = "memory",
        white: int | None = None,
    ) -> None:
        """Take the items of a tensor or an array: uint8 and bool as uint8, floats as float32.

        Args:
            items: (N, ...), a tensor, an array, or `Lazy` ones.
            names: one for each item; default: their numbers.
            latents: the known views, name → (N,) values.
            skipped: (name, reason) of each file that is not used.
            source: where the items come from, for messages.
            white: the uint8 value that stands for 1 (default: 255; of labels, 0 and one value up to 127, that value).

        Raises:
            UserError: if there is no item, a value is not finite, items are integers of another type (nothing says what
                stands for 1), or names or latents are of another length, or latents not finite.
        """
        items = checked(tensor_of(items, source), source)
        digits = max(5, len(str(len(items) - 1)))  # all alike, so that names are in order
        names = [f"{i:0{digits}d}" for i in range(len(items))] if names is None else names
        known = None if latents is None else {name: torch.as_tensor(native(v)).float() for name, v in latents.items()}
        check_columns(source, len(items), {"names": names, **(known or {})})
        values = (items, tuple(names), known, tuple(skipped), source, white or white_of(items))
        for name, value in zip(self.__dataclass_fields__, values):
            object.__setattr__(self, name, value)

    @classmethod
    def silhouettes(
        cls, path: PathLike, size: int | None = None, *, framing: Framing | None = None, strict: bool = False
    ) -> Self:
        """Read silhouettes (N, 1, H, W): coverage of each pixel by the object, in 8 bits where it was computed.

        Args:
            path: a folder of masks, cut-outs or photographs on a plain backdrop; or an .npz, .npy or idx file.
            size: pixels a side; default: 64 for a folder, as stored for arrays.
            framing: default: thresholded, cropped and centred for a folder, as they are for arrays.
            strict: fail on the first picture that cannot be used instead of skipping it.

        Raises:
            UserError: if there is nothing there that can be used.
        """
        return cls._of(find(path, ReadOptions(size, framing=framing, strict=strict)), "pictures")

    @classmethod
    def images(
        cls,
        path: PathLike,
        size: int | None = None,
        *,
        colour: bool = False,
        strict: bool = False,
        latents: Sequence[str] = (),
        unbounded: bool = False,
    ) -> Self:
        """Read pictures (N, 1, H, W) as they are: neither thresholded nor cropped.

        Args:
            path: a folder of pictures, or an .npz, .npy or idx file.
            size: pixels a side: larger pictures are averaged down, smaller ones enlarged by a whole number if they fit
                in twice, and get a dark margin; default: as stored, which must be one size for all.
            colour: keep red, green and blue, (N, 3, H, W); default: grey, 0.299 R + 0.587 G + 0.114 B.
            strict: fail on the first picture that cannot be used instead of skipping it.
            latents: names of arrays (N,) of an .npz that are latents of an operator of your own, as they are.
            unbounded: take floats of any size, not only in [0, 1].

        Raises:
            UserError: if there is nothing there that can be used.
        """
        options = ReadOptions(
            size, images=True, colour=colour, strict=strict, latents=tuple(latents), unbounded=unbounded
        )
        return cls._of(find(path, options), "pictures")

    @classmethod
    def lines(cls, path: PathLike) -> Self:
        """Read line integrals (N, 1, D) from an .npz: `lines`, (N, D) or (N, 1, D), or `sinograms`, (M, D, A).

        Raises:
            UserError: if there are none.
        """
        return cls._of(read_arrays(Path(path), ReadOptions()), "line integrals")

    @classmethod
    def volumes(
        cls,
        path: PathLike,
        size: int | None = 32,
        *,
        up_axis: UpAxis | None = None,
        classes: tuple[str, ...] = (),
        split: Literal["train", "test"] | None = None,
        strict: bool = False,
    ) -> Self:
        """Read volumes (N, size, size, size): voxels as they are stored, meshes as the solids inside them.

        Args:
            path: an .npz, .binvox or mesh file, or a folder; an archive may be followed by `:class/split`.
            size: voxels a side; None leaves voxels as stored.
            up_axis: the axis that points up in the files; default: y, but z in packed archives.
            classes: classes of a packed archive; default: all.
            split: part of a packed archive; default: train.
            strict: fail on the first file that cannot be used instead of skipping it.

        Raises:
            UserError: if there is nothing there that can be used.
        """
        found = find_volumes(Path(path), size, up_axis=up_axis, classes=classes, split=split, strict=strict)
        return cls._of(found, "volumes")

    @classmethod
    def materials(
        cls,
        path: PathLike,
        size: int | None = None,
        *,
        convention: Convention | None = None,
        strict: bool = False,
    ) -> Self:
        """Read material maps (N, 8 or 10, H, W), packed as `ops.maps` says, of folders of textures or an .npz of maps.

        Args:
            path: a folder of textures or of such folders, at any depth; or an .npz of maps, as `sample` writes them.
            size: pixels a side, area averages of the largest centred square; default: as stored.
            convention: what the textures hold; default: perceptual roughness, sRGB colours, OpenGL normals, the
                luminance of metals' colours.
            strict: fail on the first material that cannot be used instead of skipping it.

        Raises:
            UserError: if there is nothing there that can be used.
        """
        return cls(**find_materials(Path(path), size, convention, strict)._asdict())

    @classmethod
    def photographs(cls, path: PathLike, name: str, size: int, *, strict: bool = False, coloured: bool = False) -> Self:
        """Read the pictures (N, C, size, size) of the sub-folder `name`: a map's channels, or a photograph's three.

        Args:
            path: a folder with a sub-folder for each observation.
            name: of a map (`diffuse`, `normal`, ...) or of photographs (`top`, `flash`, ...).
            size: pixels a side, area averages of the largest centred square.
            strict: fail on the first picture that cannot be used instead of skipping it.
            coloured: read three channels of specular maps (default: their mean).

        Raises:
            UserError: if there is nothing there that can be used.
        """
        return cls(**find_photographs(Path(path), name, size, strict, coloured)._asdict())

    @classmethod
    def _of(cls, found: Found, kind: str) -> Self:
        if found.kind != kind:
            raise UserError(f"{found.source}: holds {found.kind}, not {kind}; name a path that holds {kind}")
        return cls(**found._asdict())

    @property
    def items(self) -> Tensor:
        """All items as they are stored, (N, ...): in memory, or mapped; those that are picked or changed are made."""
        return self.stored.whole() if isinstance(self.stored, Lazy) else self.stored

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of one item."""
        return tuple(self.stored.shape[1:])

    def __len__(self) -> int:
        return len(self.stored)

    def batch(self, rows: Rows, device: torch.device | None = None) -> Tensor:
        """Return the items of these rows as float32, items / white, on a device (default: the processor)."""
        return to_floats(self.stored[rows].to(device), self.white)

    def floats(self) -> Tensor:
        """Return all items as float32; those that are stored so without a copy."""
        return self.batch(slice(None))

    def subset(self, rows: Rows) -> Self:
        """Return the collection of these rows, in this order."""
        places = torch.arange(len(self))[rows]
        known = None if self.latents is None else {name: v[places] for name, v in self.latents.items()}
        names = tuple(self.names[i] for i in places.tolist())
        picked = Lazy(self.stored, places) if isinstance(self.stored, Lazy) else self.stored[rows]
        return type(self)(
            picked, names=names, latents=known, skipped=self.skipped, source=self.source, white=self.white
        )

    def split(self, share: float = 0.1, seed: int = 0) -> tuple[Self, Self]:
        """Return (training items, held-out items), both in order; the same seed gives the same.

        Whole groups are held out, at random: what is rendered of one shape (`chair_00012#0`, `#1`, ...), or else up to
        16 neighbours. They are `share` of all groups, but eight at least, and of less than 32 groups a quarter.

        Raises:
            UserError: for a share that is not between 0 and 1, or a collection of a single group.
        """
        kept, held_out = split_rows(self.names, share, seed, self.source)
        return self.subset(kept), self.subset(held_out)

    def warn_skipped(self) -> Self:
        """Warn of the files that are not used, if there are any; return the collection."""
        if self.skipped:
            total = len(self.skipped) + len(self)
            name, reason = self.skipped[0]
            warnings.warn(
                f"{self.source}: {len(self.skipped)} of {total} skipped, the first: {name}: {reason}", stacklevel=2
            )
        return self

    def __repr__(self) -> str:
        views = "unknown views" if self.latents is None else f"known {', '.join(self.latents)}"
        shape = " x ".join(map(str, self.shape))
        return f"{type(self).__name__}({len(self)} items of {shape} from {self.source}, {views})"


def as_floats(items: Any) -> Tensor:
    """Return the float32 items of a collection or an array, as `Collection` scales them; float tensors as they are."""
    if isinstance(items, Tensor) and items.is_floating_point():
        return items
    return (items if isinstance(items, Collection) else Collection(items)).floats()
