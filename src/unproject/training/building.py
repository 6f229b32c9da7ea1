"""Building: the generator and the domain of a run from their names in recipe.json."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from .._types import UserError
from ..domains import Domain
from .run_directory import read_recipe


def is_foreign(path: Path) -> bool:
    """Whether loading the run imports code outside this package, which needs `trust`."""
    resolved = read_recipe(path)["resolved"]
    parts = [(resolved.get("generator"), "call"), (resolved.get("domain"), "type")]
    return any(_outside(str(part.get(key))) for part, key in parts if isinstance(part, Mapping))


def _outside(name: str) -> bool:
    """Whether `module:name` is of another package."""
    return name.partition(":")[0].partition(".")[0] != "unproject"


def build_domain(path: Path, described: Any, trust: bool) -> Domain:
    if not isinstance(described, Mapping) or "type" not in described:
        raise UserError(f"{path}: recipe.json does not say how to build the domain; restore the file")
    fields = {name: value for name, value in described.items() if name != "type"}
    call = {"call": described["type"], "positional": [], "arguments": fields}
    return build(path, call, Domain, trust)


def build(path: Path, described: Any, kind: type[Any], trust: bool) -> Any:
    """Build the generator or the domain that recipe.json describes."""
    name = kind.__name__.lower()
    try:
        where, positional, arguments = str(described["call"]), described["positional"], described["arguments"]
    except (TypeError, KeyError) as error:
        raise UserError(f"{path}: recipe.json does not say how to build the {name}; restore the file") from error
    module, _, attribute = where.partition(":")
    if not trust and _outside(where):
        raise UserError(f"{path}: its {name} is {where}, code outside unproject; add --trust if you wrote it")
    if "<" in attribute:
        raise UserError(
            f"{path}: its {name} is a lambda or a function within a function, which nothing can import; train with "
            "the class itself, or functools.partial of it"
        )
    try:
        build: Any = import_module(module)
        for part in attribute.split("."):
            build = getattr(build, part)
        if trust or (isinstance(build, type) and issubclass(build, kind)):
            return build(*positional, **arguments)
    except ModuleNotFoundError as error:
        raise UserError(
            f"{path}: its {name} is {where}, and there is no module {error.name!r} here; run from its folder, install "
            "it, or if a script defined it, let @unproject.resumable remember the function that made the recipe"
        ) from error
    except Exception as error:  # a constructor refuses wrong arguments with whatever kind of error it runs into
        raise UserError(
            f"{path}: the {name} of recipe.json cannot be built ({type(error).__name__}: {error}); restore the file"
        ) from error
    raise UserError(f"{path}: recipe.json names {where}, which is no {name}; restore the file")
