"""Layers: imports go down only, packages of one layer do not import each other, and there is no cycle."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "unproject"

LAYERS = (
    ("_types", "_random", "_cores", "_files", "_objects", "_pictures", "_parent", "_silence"),
    ("ops",),
    ("projections", "networks", "data", "metrics", "export"),
    ("adversarial", "assignment", "domains", "testing"),
    ("inversion",),
    ("training",),
    ("recipes", "report", "sharing"),
    ("reproduce", "studio"),
    ("cli",),
)
LAYER_OF = {name: layer for layer, names in enumerate(LAYERS) for name in names}
FOUNDATIONS = frozenset(LAYERS[0])
ROOTS = frozenset({"unproject", "unproject.__main__"})
"""The package itself and `python -m unproject` import everything, lazily; layers do not bind them."""
NARROWER = {
    "assignment": frozenset({"data", "metrics", "networks", "ops", "projections"}),
    "domains": frozenset({"data", "export", "metrics", "networks", "ops", "projections"}),
}
"""Packages that may import less than all lower layers."""


def modules(source: Path) -> dict[str, Path]:
    """Dotted name → file, of every module under a package's folder."""
    named = {}
    for path in sorted(source.rglob("*.py")):
        parts = path.relative_to(source.parent).with_suffix("").parts
        named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


def imports(name: str, path: Path, known: set[str]) -> Iterator[str]:
    """The package's own modules that a module imports, wherever in its text."""
    base = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            targets = [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = ".".join(base[: len(base) + 1 - node.level]) if node.level else ""
            module = ".".join(part for part in (above, node.module or "") if part)
            targets = [(module, alias.name) for alias in node.names]
        else:
            continue
        for module, attribute in targets:
            deeper = f"{module}.{attribute}"
            if deeper in known or module in known:
                yield deeper if deeper in known else module


def graph(source: Path) -> dict[str, set[str]]:
    named = modules(source)
    return {name: set(imports(name, path, set(named))) - {name} for name, path in named.items() if name not in ROOTS}


def part(module: str) -> str:
    """`unproject.data.chairs` → `data`."""
    return module.split(".")[1] if "." in module else module


def wrong_imports(edges: dict[str, set[str]]) -> list[str]:
    """Every import that goes up or sideways, or from a package that may not import that layer."""
    wrong = []
    for module, targets in edges.items():
        for target in targets - ROOTS:
            here, there = part(module), part(target)
            lower = LAYER_OF[here] > LAYER_OF[there] and there in NARROWER.get(here, {there}) | FOUNDATIONS
            if not (here == there or lower or {here, there} <= FOUNDATIONS):
                wrong.append(f"{module} (layer {LAYER_OF[here]}) imports {target} (layer {LAYER_OF[there]})")
    return sorted(wrong)


def cycle(edges: dict[str, set[str]]) -> list[str]:
    """One import cycle, or an empty list."""
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_every_part_has_a_layer() -> None:
    assert {part(module) for module in graph(SOURCE)} <= set(LAYER_OF)


def test_imports_go_down_only() -> None:
    assert wrong_imports(graph(SOURCE)) == []


def test_there_is_no_import_cycle() -> None:
    assert cycle(graph(SOURCE)) == []


def test_the_foundations_import_nothing_but_each_other() -> None:
    edges = graph(SOURCE)
    assert all(part(target) in FOUNDATIONS for name in FOUNDATIONS for target in edges.get(f"unproject.{name}", ()))


MUTANTS = {
    "up": ("ops/rotation.py", "from ..training import loop"),
    "up, lazily": ("ops/rotation.py", "def f():\n    from unproject.training.loop import step"),
    "up, for types only": (
        "ops/rotation.py",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import unproject.cli",
    ),
    "up, through the package": ("data/folder.py", "from unproject import training"),
    "sideways": ("data/folder.py", "from ..metrics.score import iou"),
    "sideways, whole package": ("data/folder.py", "from .. import metrics"),
    "assignment to domains": ("assignment/panel.py", "from ..domains import volumes"),
    "domains to assignment": ("domains/volumes.py", "from ..assignment import panel"),
    "assignment to export": ("assignment/panel.py", "from ..export import meshes"),
    "assignment to adversarial": ("assignment/panel.py", "from .. import adversarial"),
    "domains to testing": ("domains/volumes.py", "from ..testing import laws"),
    "training to recipes": ("training/loop.py", "from ..recipes import shapes"),
}


@pytest.mark.parametrize("where, text", MUTANTS.values(), ids=list(MUTANTS))
def test_a_wrong_import_is_caught(tmp_path: Path, where: str, text: str) -> None:
    assert wrong_imports(graph(small_package(tmp_path))) == []
    assert len(wrong_imports(graph(small_package(tmp_path, {where: text})))) == 1


def test_a_cycle_is_caught(tmp_path: Path) -> None:
    assert cycle(graph(small_package(tmp_path))) == []
    knot = {"data/folder.py": "from .picture import read", "data/picture.py": "from . import folder"}
    assert set(cycle(graph(small_package(tmp_path, knot)))) == {"unproject.data.folder", "unproject.data.picture"}


def small_package(folder: Path, changed: dict[str, str] | None = None) -> Path:
    """A small package that keeps to the layers, with the given files in place of its own."""
    sound = {
        "__init__.py": "",
        "_types.py": "import torch",
        "ops/__init__.py": "from .rotation import rotate",
        "ops/rotation.py": "from .._types import UserError",
        "metrics/__init__.py": "",
        "metrics/score.py": "from ..ops import rotation",
        "data/__init__.py": "from .folder import read",
        "data/folder.py": "from .._types import UserError",
        "data/picture.py": "",
        "export/__init__.py": "",
        "export/meshes.py": "",
        "adversarial/__init__.py": "",
        "testing/__init__.py": "",
        "testing/laws.py": "",
        "assignment/__init__.py": "",
        "assignment/panel.py": "from ..data import folder\nfrom ..metrics import score\nfrom .._types import UserError",
        "domains/__init__.py": "",
        "domains/volumes.py": "from ..export import meshes\nfrom ..data import read",
        "recipes/__init__.py": "",
        "recipes/shapes.py": "",
        "training/__init__.py": "",
        "training/loop.py": "from ..data import folder\nfrom ..assignment import panel\nimport unproject",
        "cli/__init__.py": "from unproject.training import loop",
    }
    source = folder / "unproject"
    for name, text in {**sound, **(changed or {})}.items():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text(text, encoding="utf-8")
    return source


CONCRETE = ("Known", "Predicted", "JointlyPredicted", "LearnedPrior", "Unassigned", "Volumes", "Images", "Maps")


def named(path: Path) -> set[str]:
    """The names that a module uses."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return {node.id for node in nodes if isinstance(node, ast.Name)}


def test_training_knows_no_assignment_and_no_domain_by_name(tmp_path: Path) -> None:
    found = {path.name: named(path) & set(CONCRETE) for path in (SOURCE / "training").glob("*.py")}
    assert {name: names for name, names in found.items() if names} == {}
    (tmp_path / "mutant.py").write_text("if isinstance(assignment, Predicted): pass", encoding="utf-8")
    assert named(tmp_path / "mutant.py") & set(CONCRETE) == {"Predicted"}
