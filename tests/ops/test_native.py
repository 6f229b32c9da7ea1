"""Kernels are built once, kept, and done without where there is no compiler or the build fails."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from unproject.ops import _native, ray_rules, straight_rays
from unproject.ops.line_integrals import strip_integrals_native, strip_integrals_sparse


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache folder, and nothing remembered before or after."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    _native._library.cache_clear()
    yield tmp_path / "unproject"
    _native._library.cache_clear()


def project() -> torch.Tensor:
    image, angle = torch.rand(3, 2, 5, 5, generator=torch.Generator().manual_seed(0)), torch.tensor([0.1, 2.0, 4.0])
    y = strip_integrals_native(image, angle, 5)
    torch.testing.assert_close(y, strip_integrals_sparse(image, angle, 5))
    return y


@pytest.mark.skipif(not shutil.which("c++") and not shutil.which("g++"), reason="there is no compiler")
def test_a_kernel_is_built_once_and_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = project()
    (library,) = folder.iterdir()
    _native._library.cache_clear()
    built = library.stat().st_mtime_ns
    assert torch.equal(project(), first)
    assert library.stat().st_mtime_ns == built
    assert _native.kernel("line_integrals", "project_float") is not None


def test_without_a_compiler_the_values_are_the_same(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert _native.kernel("line_integrals", "project_float") is None
    project()
    assert not folder.exists()


def test_a_build_that_fails_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_native._builds, "FLAGS", ("--no-such-flag",))
    assert _native.kernel("line_integrals", "project_float") is None
    project()
    assert not list(folder.iterdir())


def test_it_can_be_turned_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UNPROJECT_NATIVE", "0")
    assert _native.kernel("line_integrals", "project_float") is None


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    _native._library.cache_clear()
    assert _native.kernel("line_integrals", "project_float") is None
    _native._library.cache_clear()


def test_a_machine_without_a_home_has_no_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    _native._library.cache_clear()
    assert _native.kernel("line_integrals", "project_float") is None
    _native._library.cache_clear()


LONG = 10**6
"""A side of a volume of 10¹⁸ cells: more bytes than any machine addresses."""


@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize(
    ("source", "name", "job"),
    [
        ("ray_rules", "any_forward", ray_rules.Job(x=LONG, y=LONG, z=LONG)),
        ("ray_rules", "sum_back", ray_rules.Job(x=LONG, y=LONG, z=LONG)),
        ("straight_rays", "spread", straight_rays.Job(x=LONG, y=LONG, z=LONG)),
    ],
)
def test_a_kernel_without_memory_raises(source: str, name: str, kind: str, job: ctypes.Structure) -> None:
    """It would end the process: no exception passes through C. A batch of none reads no tensor."""
    call = _native.kernel(source, f"{name}_{kind}")
    if call is None:
        pytest.skip("there is no compiler")
    with pytest.raises(MemoryError, match="memory is used up"):
        call(ctypes.byref(job))


def test_lines_without_memory_raise() -> None:
    call = _native.kernel("line_integrals", "project_float")
    if call is None:
        pytest.skip("there is no compiler")
    with pytest.raises(MemoryError, match="memory is used up"):
        call(None, None, None, None, *map(ctypes.c_int64, (0, 1, 1, LONG**3, LONG**3)))
