"""The axis legend, the array types and the one exception a user is meant to see.

Axis legend (docs/conventions.md has the pictures):

========== =============== ====================================================
name       shape           meaning
========== =============== ====================================================
`Volume`   (B, X, Y, Z)    occupancy in [0, 1]; x right, y up, z towards the viewer
`Image`    (B, C, H, W)    row 0 is the top of the picture
`Latent`   (B,)            one latent parameter of a projection; angles in radians
`Code`     (B, L)          the input of a generator
`Logits`   (B,)            what a discriminator says of each image
========== =============== ====================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from torch import Tensor

    Volume: TypeAlias = Tensor
    Image: TypeAlias = Tensor
    Latent: TypeAlias = Tensor
    Latents: TypeAlias = dict[str, Tensor]
    Code: TypeAlias = Tensor
    Logits: TypeAlias = Tensor


class UserError(ValueError):
    """Something the user can mend: the message says what, where and how to mend it.

    The command line prints it as one line, `unproject: <message>`, and exits with status 2.
    """
