"""The axis legend, and the exceptions for mistakes of a user and for trainings that break down.

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

NO_MEMORY = ("not enough memory", "can't allocate memory", "out of memory")
"""Torch's words, by system and device."""


def printable(text: object) -> str:
    r"""Return text for one line of a terminal: names of files may hold anything.

    Examples:
        >>> printable("a\nb")
        'a\\nb'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))


def is_lack_of_memory(error: BaseException) -> bool:
    """Whether an error says that memory could not be had."""
    said = isinstance(error, RuntimeError) and any(words in str(error) for words in NO_MEMORY)
    return said or isinstance(error, MemoryError)


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


class Diverged(UserError):
    """Training cannot go on: a number is not finite, or everything generated looks the same."""
