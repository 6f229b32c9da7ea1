"""The reference: a page for each submodule with every name of its `__all__`, and one of the command line's `--help`.

All of it is written when the site is built.
An object is documented once, under the name that users type: `unproject.Panel`, not `unproject.assignment.panel.Panel`.
"""

from __future__ import annotations

import inspect
import re
import sys
from contextlib import redirect_stdout, suppress
from functools import cache
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer

import unproject
from unproject.cli import VERBS, main
from unproject.cli.data import ACTIONS

MODULES = unproject._SUBMODULES
TYPES = {
    "adversarial": ("adaptive.AdaptiveState",),
    "assignment": ("assigned.Assigned", "unassigned.UnassignedState", "mean_shape.Fitted"),
    "data": ("inspection.FileRow", "lazy.Lazy", "observing.Observing"),
    "domains": ("evidence.Evidence",),
    "inversion": ("candidates.Candidates",),
    "networks": ("materials.MaterialGenerator",),
    "ops": ("framing.Box", "microfacet.Reflection", "shading.Sampling"),
    "projections": ("view.View", "silhouette.Window"),
    "testing": ("laws.Case",),
}
"""What signatures of public names speak of."""


def home(name: str) -> str:
    """Return the submodule on whose page a public name of `unproject` is documented, "" for the first page."""
    module = unproject._HOME[name].split(".")[1]
    return "" if module.startswith("_") else module


def members(module: str) -> list[str]:
    """Return the full names that a submodule's page documents."""
    part = import_module(f"unproject.{module}")
    top = [f"unproject.{name}" for name in unproject._HOME if home(name) == module]
    own = getattr(part, "__all__", [name for name, value in vars(part).items() if of(value, part)])
    own = [*(name for name in own if name not in unproject._HOME), *TYPES.get(module, ())]
    return top + [f"unproject.{module}.{name}" for name in own]


def of(value: Any, module: ModuleType) -> bool:
    return inspect.isfunction(value) and value.__module__ == module.__name__


def find(name: str) -> Any:
    module, _, last = name.rpartition(".")
    return getattr(import_module(module), last)


def directive(name: str) -> str:
    value = find(name)
    if inspect.isclass(value):
        return f".. autoclass:: {name}\n   :members:\n   :show-inheritance:\n"
    return f".. autofunction:: {name}\n" if callable(value) else f".. py:data:: {name}\n\n   {constant(name)}\n"


def constant(name: str) -> str:
    """Return the docstring of a constant, which stands in the module that defines it."""
    module, _, last = name.rpartition(".")
    for other in [other for other in sys.modules if other.startswith(module)]:
        lines = ModuleAnalyzer.for_module(other).find_attr_docs().get(("", last))
        if lines and getattr(sys.modules[other], last) is find(name):
            return escaped(" ".join(lines).strip())
    return ""


def heading(text: str, mark: str = "=") -> str:
    return f"{text}\n{mark * len(text)}\n"


def page(module: str) -> str:
    parts = [heading(f"unproject.{module}"), f".. automodule:: unproject.{module}\n   :no-members:\n"]
    parts += [directive(name) for name in members(module)]
    if module == "recipes":
        parts += [heading("The recipes", "-"), *(recipe(name) for name in unproject.recipes.names())]
    return "\n".join(parts)


def recipe(name: str) -> str:
    function = unproject.recipes.find(name)
    return f"``{name}``\n\n.. autofunction:: {function.__module__}.{function.__name__}\n"


def first_page() -> str:
    names = [f"* - :py:obj:`unproject.{name}`\n     - {summary(name)}" for name in unproject._HOME]
    table = ".. list-table::\n   :widths: 30 70\n\n   " + "\n   ".join(names)
    toctree = ".. toctree::\n   :hidden:\n\n" + "".join(f"   {module}\n" for module in MODULES)
    modules = [f"- :doc:`unproject.{module} <{module}>`: {first_line(module)}" for module in MODULES]
    intro = "Every public name, from the docstrings; ``import unproject as up`` gives those of the table.\n"
    own = [directive(f"unproject.{name}") for name in unproject._HOME if not home(name)]
    parts = [
        heading("API reference"),
        ".. py:module:: unproject\n",
        intro,
        toctree,
        heading("By submodule", "-"),
        "\n".join(modules) + "\n",
    ]
    return "\n".join([*parts, heading("Names of unproject", "-"), table + "\n", *own])


def command_line() -> str:
    further = [["train", recipe] for recipe in ("shapes", "digits", "wood")] + [["data", action] for action in ACTIONS]
    commands = [[], *([verb] for verb in VERBS), *further]
    parts = [
        heading("The command line"),
        "What ``unproject VERB --help`` prints; `usage <../usage.html>`_ is a tour.\n",
    ]
    for words in commands:
        text = "\n".join("   " + line for line in help_of(words).splitlines())
        parts.append(heading(" ".join(["unproject", *words]), "-") + f"\n.. code-block:: text\n\n{text}\n")
    return "\n".join(parts)


def help_of(words: list[str]) -> str:
    with redirect_stdout(StringIO()) as printed, suppress(SystemExit):
        main([*words, "--help"])
    return printed.getvalue()


def first_line(module: str) -> str:
    return (import_module(f"unproject.{module}").__doc__ or "").partition("\n")[0]


def summary(name: str) -> str:
    return escaped((inspect.getdoc(getattr(unproject, name)) or "").partition("\n\n")[0].replace("\n", " "))


def escaped(line: str) -> str:
    """Docstrings are plain text with `names`: |x|, **kwargs and `n`×`n` are no markup in them."""
    line = re.sub(r"(?<!`)(`[^`]+`)(?=[^\s`.,;:!?)\]}'\"/-])", r"\1\\ ", line)
    return re.sub(r"\*\*|\|", lambda found: "".join("\\" + mark for mark in found[0]), line)


def escape(app: Sphinx, what: str, name: str, part: Any, options: Any, lines: list[str]) -> None:
    """Escape a docstring's lines, but for those of examples."""
    if what in ("attribute", "property"):
        lines.insert(0, "")  # else Napoleon takes what stands before a colon in the first line for a type
    example = False
    for number, line in enumerate(lines):
        example = bool(line.strip()) and (example or line.lstrip().startswith(">>>"))
        lines[number] = line if example else escaped(line)


def write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "docs" / "api"
    folder.mkdir(exist_ok=True)
    pages = {"index": first_page(), "command-line": command_line(), **{module: page(module) for module in MODULES}}
    for name, text in pages.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


@cache
def public_names() -> dict[str, str]:
    """Return where an object is defined → the name that it is documented under."""
    names = {}
    for name in (name for module in MODULES for name in members(module)):
        value = find(name)
        if inspect.isclass(value) or inspect.isfunction(value):
            names[f"{value.__module__}.{value.__qualname__}"] = name
    return names


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, contnode: nodes.Element) -> nodes.Element | None:
    """Lead from where an object is defined, or the submodule that hands it on, to where it is documented."""
    if node.get("refdomain") != "py":
        return None
    target = public_names().get(node["reftarget"])
    if target is None:
        return None
    return env.domains["py"].resolve_any_xref(env, node["refdoc"], app.builder, target, node, contnode)[0][1]
