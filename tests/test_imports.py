"""`import unproject` and `unproject --help` are cheap: counted in modules, since seconds depend on the machine."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from unproject.cli import VERBS

HEAVY = ("torch", "numpy", "scipy", "PIL", "trimesh", "skimage", "tensorboard", "rich", "tyro")


def modules_after(code: str) -> set[str]:
    """The names of the modules that a fresh interpreter has imported once it ran the code."""
    report = "import json, sys; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize(
    "code",
    [
        "import unproject; dir(unproject)",
        "from unproject.cli import main; main(['--help'])",
        "from unproject.cli import main; main(['--version'])",
        "from unproject.cli import main; main(['trian'])",
    ],
)
def test_no_heavy_module_is_imported(code: str) -> None:
    loaded = modules_after(code)
    assert [name for name in HEAVY if name in loaded] == []


def test_the_import_is_small() -> None:
    added = modules_after("import unproject") - modules_after("")
    assert len({name for name in added if name.startswith("unproject")}) == 1
    assert len(added) < 40


def test_help_imports_little() -> None:
    added = modules_after("from unproject.cli import main; main(['--help'])") - modules_after("")
    assert len(added) < 80


@pytest.mark.parametrize("verb", [*VERBS])
def test_a_verbs_help_needs_no_torch(verb: str) -> None:
    loaded = modules_after(f"from unproject.cli import main; assert main([{verb!r}, '--help']) == 0")
    assert "torch" not in loaded


def test_heavy_modules_would_be_noticed() -> None:
    assert "numpy" in modules_after("import numpy")


def test_a_surface_without_smoothing_does_without_trimesh() -> None:
    assert "trimesh" not in modules_after("import unproject.ops.isosurface")
