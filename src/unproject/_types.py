"""The axis legend, the array types and the exception for mistakes of a user.

Axis legend (docs/conventions.md has the pictures):

========== =============== ====================================================
name       shape           meaning
========== =============== ====================================================
`Volume`   (B, X, Y, Z)    occupancy in [0, 1]; x right, y up, z towards the viewer
`Image`    (B, C, H, W)    row 0 is the top of the picture
`Latent`   (B,)            one latent parameter of a projection; angles in radians
`Code`     (B, L)          the input of a generator
`Logits`   (B,)            the scores that a discriminator gives the images
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


def printable(text: object) -> str:
    r"""Return text for one line of a terminal: names of files may hold anything.

    Examples:
        >>> printable("a\nb")
        'a\\nb'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))


def check_widths(where: str, **widths: int) -> None:
    """Raise UserError for a width of a network that is less than 1.

    Examples:
        >>> check_widths("generator", channels=0)
        Traceback (most recent call last):
        ...
        unproject._types.UserError: generator: channels=0; give at least 1
    """
    for name, width in widths.items():
        if width < 1:
            raise UserError(f"{where}: {name}={width}; give at least 1")


class UserError(ValueError):
    """A mistake that the user can fix; the message says what, where and how.

    The command line prints it as one line, `unproject: <message>`, and exits with status 2.

    Examples:
        >>> import unproject as up
        >>> up.Uniform("azimuth", 1, 0)
        Traceback (most recent call last):
        ...
        unproject._types.UserError: Uniform('azimuth', 1, 0): give finite low <= high
    """
