"""What a fit is given: pictures of one object, and what is known of their views."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError
from .viewing import Latents, Viewing

OTHER_UNIT, MIN_LARGEST = 10.0, 0.01
"""Pictures so many times as bright as any projection are of another unit; the brightest projection is taken to be at
least so bright, as samples of a run that has just begun may be dark."""


@dataclass(frozen=True)
class Pictures:
    """Pictures (M, ...) of one object, what is known of their views, (M,) by name, and their possible bins (M, K)."""

    y: Tensor
    known: dict[str, Tensor]
    possible: Tensor

    @classmethod
    def of(cls, y: Tensor, known: Latents, viewing: Viewing) -> Pictures:
        """Return pictures with what is known of their views.

        Raises:
            UserError: if that is no latent of the viewing's projection, of another number, or not finite.
        """
        latents = (*viewing.projection.latents, *viewing.projection.optional_latents)
        known = {name: torch.as_tensor(value).float() for name, value in known.items()}
        for name, value in known.items():
            if name not in latents or tuple(value.shape) != (len(y),):
                raise UserError(
                    f"known {name!r} of shape {tuple(value.shape)}: give ({len(y)},) values of "
                    f"{', '.join(latents) or 'nothing, as these pictures have no latents'}"
                )
            if not bool(value.isfinite().all()):
                raise UserError(f"known {name!r} has values that are NaN or infinite; leave out what is not known")
        if strange := viewing.outside(known):
            warnings.warn(
                f"known {', '.join(strange)}: of some pictures outside all that this run was trained on; angles are in "
                "radians",
                stacklevel=3,
            )
        return cls(y, known, viewing.possible(known, len(y)))

    def __len__(self) -> int:
        return len(self.y)


def check_pictures(y: Tensor, projections: Tensor) -> None:
    """Check pictures (M, ...) by the projections (C, K, ...) of samples.

    Raises:
        UserError: if there is none, one that is not finite, or they are of another size.
    """
    wanted, given = tuple(projections.shape[2:]), tuple(y.shape[1:])
    if given != wanted or not len(y):
        raise UserError(f"{len(y)} pictures of {given}; give at least one, of {wanted} as in training")
    if not bool(y.isfinite().all()):
        raise UserError("fit: pictures have values that are NaN or infinite; replace them, or leave them out")


def warn_of_unit(y: Tensor, projections: Tensor) -> None:
    """Warn of pictures that are far brighter than the projections of samples."""
    most, usual = y.abs().max().item(), projections.abs().max().item()
    if most > OTHER_UNIT * max(usual, MIN_LARGEST):
        warnings.warn(
            f"pictures reach {most:.3g}, and projections of samples {usual:.3g}: give them in the unit of projections, "
            "as `from_measured` of the run's projection converts readings",
            stacklevel=4,
        )
