"""The wheel: what is in it, and that its kernels are used and right, each of those that this processor can run."""

from __future__ import annotations

import platform
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import torch

from unproject.ops import _builds, _native
from unproject.ops.line_integrals import strip_integrals_native, strip_integrals_sparse

ROOT = Path(__file__).parents[1]
OPS = ROOT / "src" / "unproject" / "ops"
can_compile = pytest.mark.skipif(not _builds.can_compile(), reason="there is no compiler, or this is not Linux")


FILES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "NOTICE")


def sources() -> list[str]:
    files = subprocess.run(["git", "ls-files", "src"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in files.stdout.split() if (ROOT / name).exists()]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built of a copy, since setuptools writes beside what it builds."""
    copy = tmp_path_factory.mktemp("copy")
    for name in (*FILES, *sources()):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_bytes((ROOT / name).read_bytes())
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run([*pip, "-w", str(copy / "dist"), str(copy)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = (copy / "dist").iterdir()
    return wheel


@pytest.fixture(scope="module")
def kernels(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder / "unproject" / "ops" / "kernels"


def sorted_names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


@can_compile
def test_each_kernel_is_there_for_each_capability(kernels: Path) -> None:
    of = _builds.CAPABILITIES if platform.machine() in ("x86_64", "AMD64") else ("DEFAULT",)
    sources = [file.stem for file in OPS.glob("*.cpp")]
    assert sorted_names(kernels) == sorted(_builds.shipped_name(s, c) for s in sources for c in of)


@can_compile
@pytest.mark.parametrize("capability", _builds.CAPABILITIES)
def test_the_best_kernel_that_the_processor_can_run_is_taken_and_right(
    capability: str, kernels: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = torch.backends.cpu.get_cpu_capability()
    order = list(_builds.CAPABILITIES)
    if own not in order or order.index(capability) > order.index(own):
        pytest.skip(f"this processor has {own}")
    monkeypatch.setattr(_native, "SHIPPED", kernels)
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    _native._library.cache_clear()
    try:
        taken = Path(_native._library("line_integrals")._name)
        assert taken == kernels / _builds.shipped_name("line_integrals", capability)
        image, angle = torch.rand(3, 2, 9, 9, generator=torch.Generator().manual_seed(0)), torch.tensor([0.1, 2.0, 4.0])
        torch.testing.assert_close(strip_integrals_native(image, angle, 9), strip_integrals_sparse(image, angle, 9))
    finally:
        _native._library.cache_clear()


@can_compile
def test_a_kernel_that_cannot_be_loaded_gives_way_to_the_next(kernels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if torch.backends.cpu.get_cpu_capability() not in ("AVX2", "AVX512"):
        pytest.skip("this processor has one kind of kernel")
    folder = kernels.parent / "broken"
    folder.mkdir()
    for name in sorted_names(kernels):
        (folder / name).write_bytes((kernels / name).read_bytes() if ".default." in name else b"no library")
    monkeypatch.setattr(_native, "SHIPPED", folder)
    assert Path(_native._shipped("shading")._name).name == _builds.shipped_name("shading", "DEFAULT")


def test_a_wheel_has_what_the_package_needs_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    packed = {f"src/{name}" for name in names if name.startswith("unproject/") and "/kernels/" not in name}
    assert packed == set(sources())
    kernels = [name for name in names if "/kernels/" in name]
    assert bool(kernels) == _builds.can_compile() and wheel.name.startswith("unproject-") and "-py3-none-" in wheel.name
    assert any(name.endswith("licenses/NOTICE") for name in names)
