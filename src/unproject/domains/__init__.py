"""Domains: what generators make. A generator's class names a built-in one; a recipe may give one of its own."""

from __future__ import annotations

from collections.abc import Collection as Names

from .._types import UserError
from ..networks import Generator
from .domain import Domain, Exporter
from .images import Images
from .maps import Maps, relit
from .volumes import Volumes

BUILT_IN: dict[str, Domain] = {"volumes": Volumes(), "images": Images(), "maps": Maps()}


def domain_of(generator: Generator, given: Domain | None = None) -> Domain:
    """Return the domain given, or the built-in one that the generator's class names.

    Raises:
        UserError: if there is neither.
    """
    if given is not None:
        return given
    if generator.domain not in BUILT_IN:
        raise UserError(
            f"{type(generator).__name__} does not say what it makes; give Recipe(domain=...), or set its class "
            f"attribute `domain` to one of {', '.join(BUILT_IN)}"
        )
    return BUILT_IN[generator.domain]


def domain_of_arrays(names: Names[str]) -> Domain:
    """Return the built-in domain of an .npz that `unproject sample` wrote, by the names of its arrays."""
    if "image" in names:
        return BUILT_IN["images"]
    return BUILT_IN["maps" if "diffuse" in names else "volumes"]


__all__ = ["BUILT_IN", "Domain", "Exporter", "Images", "Maps", "Volumes", "domain_of", "domain_of_arrays", "relit"]
