"""Building: the generator and the domain of a run from their names in recipe.json."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from .._objects import module_name
from .._types import UserError
from ..domains import Domain
from .run_directory import read_recipe


def foreign_code(path: Path) -> list[str]:
    """Return the names `module:name` outside this package that loading the run imports, which needs `trust`."""
    resolved = read_recipe(path)["resolved"]
    parts = [(resolved.get("generator"), "call"), (resolved.get("domain"), "type")]
    names = [str(part.get(key)) for part, key in parts if isinstance(part, Mapping)]
    return [name for name in names if _outside(name)]


def _outside(name: str) -> bool:
    """Whether `module:name` is of another package."""
    return name.partition(":")[0].partition(".")[0] != "unproject"


BY_RECIPE = "open it by its recipe, unproject.load(path, recipe=recipe)"


def _imported(module: str, attribute: str) -> Any:
    """Return what a module holds; the script that runs is not imported again."""
    found: Any = sys.modules["__main__"] if module == module_name("__main__") else import_module(module)
    for part in attribute.split("."):
        found = getattr(found, part)
    return found


class _DigestError(UserError):
    """An argument of which recipe.json holds the digest alone."""


def _check_arguments(path: Path, name: str, arguments: Mapping[str, Any]) -> None:
    """Raise UserError for tensors, arrays and collections, of which recipe.json holds the digest alone."""
    for key, value in arguments.items():
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, Mapping) and "sha256" in part:
                (kind,) = {"tensor", "array", "collection"} & part.keys() or {"tensor"}
                raise _DigestError(
                    f"{path}: argument {key!r} of its {name} is of the type {kind}, of which recipe.json holds the "
                    f"digest alone; {BY_RECIPE}, or make it a buffer that the checkpoint restores"
                )
            if isinstance(part, Mapping):
                _check_arguments(path, name, part)


def _argument(value: Any, trust: bool) -> Any:
    """Return an argument that recipe.json describes: classes and functions are imported, with `trust`."""
    if isinstance(value, list):
        return [_argument(part, trust) for part in value]
    if not isinstance(value, Mapping):
        return value
    if trust and "call" in value:
        found = _imported(*str(value["call"]).split(":"))
        given = {key: _argument(part, trust) for key, part in value["arguments"].items()}
        more = [_argument(part, trust) for part in value["positional"]]
        return partial(found, *more, **given) if more or given else found
    return {key: _argument(part, trust) for key, part in value.items()}


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
        raise UserError(
            f"{path}: its {name} is {where}, code outside unproject; add --trust (trust=True) if you wrote it"
        )
    if "<" in attribute:
        raise UserError(
            f"{path}: its {name} is a lambda or a function within a function, which nothing can import; {BY_RECIPE}, "
            "or train with the class itself, or functools.partial of it"
        )
    try:
        _check_arguments(path, name, {**arguments, **{str(i): value for i, value in enumerate(positional)}})
        found = _imported(module, attribute)
        if trust or (isinstance(found, type) and issubclass(found, kind)):
            given = {key: _argument(value, trust) for key, value in arguments.items()}
            return found(*(_argument(value, trust) for value in positional), **given)
    except _DigestError:
        raise
    except ModuleNotFoundError as error:
        raise UserError(
            f"{path}: its {name} is {where}, and there is no module {error.name!r} here; run from its folder, install "
            "it, or if a script defined it, let @unproject.resumable remember the function that made the recipe, or "
            f"{BY_RECIPE}"
        ) from error
    except AttributeError as error:
        if module == "__main__":  # of a notebook or a script that was read from standard input
            raise UserError(f"{path}: its {name} is {where} of another session; {BY_RECIPE}") from error
        raise UserError(f"{path}: its {name} is {where}, which {error}; {BY_RECIPE}") from error
    except Exception as error:  # a constructor refuses wrong arguments with whatever kind of error it runs into
        raise UserError(
            f"{path}: the {name} of recipe.json cannot be built ({type(error).__name__}: {error}); restore the file"
        ) from error
    raise UserError(f"{path}: recipe.json names {where}, which is no {name}; restore the file")
