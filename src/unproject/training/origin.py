"""Origin: recipe functions, and how a run's recipe is made again from recipe.json."""

from __future__ import annotations

import functools
import inspect
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec

from .._files import understood
from .._objects import find_object, import_name
from .._types import UserError
from .description import full_name
from .recipe import Options, Origin, Recipe
from .run_directory import RESTORE, read_recipe

P = ParamSpec("P")
OPTIONS = tuple(Options.__annotations__)


def resumable(function: Callable[P, Recipe]) -> Callable[P, Recipe]:
    """Let the recipes that a function makes remember how they were made, so that their runs resume by path alone.

    Examples:
        >>> import unproject as up
        >>> from typing_extensions import Unpack
        >>> @up.resumable
        ... def volumes(*, count: int = 4, **options: Unpack[up.Options]) -> up.Recipe:
        ...     panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(up.data.chairs(count, 16)))
        ...     return up.Recipe(up.networks.LowRankGenerator, [panel], steps=10).configured(options)
        >>> volumes(count=3, steps=5).origin.arguments
        {'count': 3, 'steps': 5}
    """

    @functools.wraps(function)
    def remembered(*positional: P.args, **arguments: P.kwargs) -> Recipe:
        made = function(*positional, **with_paths(function, arguments))  # pyright: ignore[reportCallIssue]
        named = [
            name for name, p in inspect.signature(function).parameters.items() if p.kind is p.POSITIONAL_OR_KEYWORD
        ]
        given: dict[str, Any] = {**dict(zip(named, positional, strict=False)), **arguments}
        if len(positional) > len(named) or not all(map(_storable, given.values())):
            return made
        return made.replace(origin=origin_of(import_name(function), import_name(function), with_paths(function, given)))

    vars(remembered)["is_resumable"] = True
    return remembered


def make(name: str, function: Callable[..., Any], arguments: dict[str, Any]) -> Recipe:
    """Call a recipe function as `unproject train NAME` does; options that it does not take itself are set afterwards.

    Raises:
        UserError: if it does not take an argument that is no option, or returns no recipe.
    """
    own, options = split(function, arguments)
    made = function(**own)
    if not isinstance(made, Recipe):
        raise UserError(f"{name} returned {type(made).__name__}; name a function that returns a Recipe")
    given = {key: value for key, value in options.items() if value is not None}
    where = name if name.rpartition(":")[0].endswith(".py") else import_name(function)
    seed = {"seed": given.pop("seed")} if "seed" in given else {}
    made = made.configured(given).replace(**seed)  # pyright: ignore[reportArgumentType]
    arguments = with_paths(function, {**arguments, **_chosen(made.origin, arguments)})
    return made.replace(origin=origin_of(name, where, arguments))


def _chosen(origin: Origin | None, arguments: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments that a recipe function chose itself, where none were given."""
    remembered = {} if origin is None else origin.arguments
    return {name: value for name, value in remembered.items() if arguments.get(name) is None}


def split(function: Callable[..., Any], arguments: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split arguments into those that the function takes and options of `Recipe` that it does not."""
    parameters = inspect.signature(function).parameters
    further = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    unknown = sorted(arguments.keys() - parameters.keys() - {*OPTIONS, "seed"})
    if unknown:
        raise UserError(
            f"recipe {full_name(function)} does not take {', '.join(unknown)}; use the version that the run began with"
        )
    own, options = {}, {}
    for name, value in arguments.items():
        if name in parameters or (further and value is not None):
            own[name] = value
        elif not further:
            options[name] = value
    return own, options


def with_paths(function: Callable[..., Any], arguments: dict[str, Any]) -> dict[str, Any]:
    """Return arguments with strings as paths where the function takes a path: `data="my_masks"`."""
    parameters = inspect.signature(function).parameters

    def takes_path(name: str) -> bool:
        return name in parameters and re.search(r"\bPath\b", str(parameters[name].annotation)) is not None

    return {name: Path(v) if isinstance(v, str) and takes_path(name) else v for name, v in arguments.items()}


def origin_of(name: str, function: str, arguments: dict[str, Any]) -> Origin:
    """Return what recipe.json stores of a call: paths become absolute, so that a run resumes from any folder."""
    return Origin(_absolute(name), _absolute(function), {key: _stored(value) for key, value in arguments.items()})


def read_origin(path: Path) -> Origin | None:
    """Return how the run's recipe was made, or None if no recipe function made it."""
    stored = read_recipe(path)
    recipe, function, arguments = stored["recipe"], stored["function"], stored["arguments"]
    if not function:
        return None
    if function.startswith("unproject."):
        arguments = {**_before_there_was(function, stored["resolved"]), **arguments}
        if function.startswith("unproject.recipes.materials:") and arguments.get("observations") is None:
            arguments["observations"] = _observed(stored["resolved"])
    return Origin(recipe, function, arguments)


def _before_there_was(function: str, resolved: dict[str, Any]) -> dict[str, Any]:
    """Return what newer flags of our recipes have to be for runs of before there were these flags."""
    older: dict[str, Any] = {"precision": "float32"}
    if function == "unproject.recipes.shapes:shapes":
        terms = json.dumps(resolved.get("regulariser"))
        flags = ("rectilinear", "varied", "inflated", "axisymmetric")
        older |= {flag: 0.0 for flag in flags if flag.capitalize() not in terms}
        older |= {} if "coarse" in resolved else {"coarse_to_fine": False}
    if "StationaryMaterials" in (generator := json.dumps(resolved.get("generator"))) and "cycles" not in generator:
        older["waves"] = False
    return older


def _observed(resolved: dict[str, Any]) -> list[str]:
    """Return the observations of a run of materials of before recipes wrote down which they had chosen."""
    names = [panel["observations"][0]["name"] for panel in resolved["panels"]]
    return (
        ["diffuse", "specular", "roughness", "normal", "flash", "coloured", "ambient"] if "itself" in names else names
    )


def rebuild(origin: Origin | None, trust: bool = False, **changes: Any) -> Recipe:
    """Make the recipe of a run again, with some arguments changed.

    Args:
        changes: arguments; None leaves the run's own. A budget takes the place of the run's own.

    Raises:
        UserError: if the recipe was not made by a recipe function, or the function is not of this package and `trust`
            is not given: importing it would run its code.
    """
    if origin is None or not origin.function:
        raise UserError(
            "this run's recipe was built in Python; give it: unproject.resume(path, recipe) or "
            "unproject.load(path, recipe=recipe); or let @unproject.resumable remember the function that builds it"
        )
    function = _trusted(origin, trust)
    for name, value in origin.arguments.items():
        place = _restored(value)
        if isinstance(place, Path) and not place.exists():
            raise UserError(
                f"{place}: this run's {name} lie there no longer; put them back, or a link to where they are"
            )
    changes = {name: value for name, value in changes.items() if value is not None}
    kept = {key: _restored(value) for key, value in origin.arguments.items()}
    if {"steps", "minutes"} & changes.keys():
        kept = {key: value for key, value in kept.items() if key not in ("steps", "minutes")}
    with understood("recipe.json", f"the arguments of {origin.recipe} are no longer what it takes: {RESTORE}"):
        return make(origin.recipe, function, {**kept, **changes})


def _trusted(origin: Origin, trust: bool) -> Callable[..., Any]:
    """Return the recipe function; without `trust` only a resumable one of this package, not what a module imported."""
    outside = UserError(f"this run's recipe is {origin.recipe}, code outside unproject; add --trust (trust=True)")
    if not trust and not origin.function.startswith("unproject."):
        raise outside
    function = find_object(origin.function)
    if not trust and not getattr(function, "is_resumable", False):
        raise outside
    return function


def _absolute(where: str) -> str:
    source, colon, function = where.rpartition(":")
    return f"{Path(source).absolute()}{colon}{function}" if source.endswith(".py") else where


def _storable(value: Any) -> bool:
    return (
        value is None
        or isinstance(value, (bool, int, float, str, Path))
        or (isinstance(value, (tuple, list)) and all(map(_storable, value)))
    )


def _stored(value: Any) -> Any:
    if isinstance(value, (tuple, list)):
        return type(value)(map(_stored, value))
    return {"path": str(value.absolute())} if isinstance(value, Path) else value


def _restored(value: Any) -> Any:
    if isinstance(value, dict) and set(value) == {"path"} and isinstance(value["path"], str):
        return Path(value["path"])
    return tuple(map(_restored, value)) if isinstance(value, list) else value
