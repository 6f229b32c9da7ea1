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
    lines = [f"{name}({', '.join(map(_plain, parameters))})", "", inspect.getdoc(function) or "(no docstring)"]
    return "\n".join([*lines, "", f"`unproject train {name} --help` lists its flags."])


def _plain(p: inspect.Parameter) -> str:
    """`size: int = 32`, the annotation as it is written."""
    kind = "" if p.annotation is p.empty else f": {getattr(p.annotation, '__name__', p.annotation)}"
    return f"{p.name}{kind}" + ("" if p.default is p.empty else f" = {p.default!r}")
