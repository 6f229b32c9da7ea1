"""`unproject recipes [list | show NAME]`."""

from __future__ import annotations

import inspect
from typing import Literal

from .._types import UserError
from ._arguments import find_recipe


def run(action: Literal["list", "show"] = "list", name: str | None = None, /) -> None:
    """List the recipes, or show one: what it is and the flags it adds to `unproject train`.

    Args:
        action: `list` all recipes, or `show` one.
        name: The recipe to show: a built-in name, module:function or path/to/file.py:function.
    """
    if action == "show":
        if name is None:
            raise UserError("recipes show: name the recipe; `unproject recipes` lists them")
        print(_shown(name))
    else:
        print(_listed())


def _listed() -> str:
    from unproject import recipes

    table = recipes.names()
    width = max(map(len, table), default=0)
    return "\n".join(f"{name:<{width}}  {line}" for name, line in table.items())


def _shown(name: str) -> str:
    function = find_recipe(name)
    parameters = inspect.signature(function).parameters.values()
    flags = [_flag(p) for p in parameters if p.kind is not p.VAR_KEYWORD]
    lines = [inspect.getdoc(function) or "(no docstring)", "", "flags:", *flags]
    return "\n".join([name, "", *lines, "", f"`unproject train {name} --help` says what they do."])


def _flag(p: inspect.Parameter) -> str:
    """`  --size 32`, as on the command line; a switch that is on can be turned off."""
    flag = p.name.replace("_", "-")
    if isinstance(p.default, bool):
        return f"  --no-{flag}" if p.default else f"  --{flag}"
    kind = "" if p.annotation is p.empty else f" {getattr(p.annotation, '__name__', p.annotation)}"
    default = "" if p.default in (p.empty, None) else f" (default: {_words(p.default)})"
    return f"  --{flag}{kind}{default}"


def _words(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, (tuple, list)) else str(value)
