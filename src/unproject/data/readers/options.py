"""How pictures are read."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from .framing import Framing


@dataclass(frozen=True)
class ReadOptions:
    """How pictures are read: framed as silhouettes, or as they are.

    Attributes:
        size: pixels (or voxels) a side; None: what the reader takes by default.
        images: take pictures as they are, without framing.
        colour: keep the three channels of images.
        framing: of silhouettes; None: `Framing()` for folders, `AS_GIVEN` for arrays.
        strict: fail on the first picture that cannot be used instead of skipping it.
        latents: of an operator of one's own: names of arrays beside the images that are its latents, as they are.
        unbounded: images may have floats of any size, as operators of one's own may give them.
    """

    size: int | None = None
    _: KW_ONLY
    images: bool = False
    colour: bool = False
    framing: Framing | None = None
    strict: bool = False
    latents: tuple[str, ...] = ()
    unbounded: bool = False
