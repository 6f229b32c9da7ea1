"""What is installed, under which licences, and that the network is left alone."""

from __future__ import annotations

import ast
import re
import socket
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from unproject.cli import main

ROOT = Path(__file__).parents[1]
FETCHES = {"data/download.py", "sharing/hub.py"}
SERVES = ("studio/",)
NETWORK = {
    "socket",
    "socketserver",
    "http",
    "urllib",
    "ftplib",
    "smtplib",
    "requests",
    "pooch",
    "httpx",
    "aiohttp",
    "huggingface_hub",
}
PERMISSIVE = re.compile(r"^(MIT|BSD|Apache|PSF|0BSD|Zlib|CC0|BSL|MPL-2.0|OR|AND|WITH LLVM)")


def pins(name: str) -> dict[str, str]:
    found = re.findall(r"^([A-Za-z0-9_.-]+)==(\S+)", (ROOT / name).read_text(), re.MULTILINE)
    return {re.sub(r"[-_.]+", "-", package).lower(): version for package, version in found}


def test_what_is_locked_is_what_the_tests_ran_with() -> None:
    tested = pins("constraints.txt")
    assert {package: tested.get(package) for package in pins("requirements.lock")} == pins("requirements.lock")


def test_all_that_the_package_needs_is_locked_with_hashes() -> None:
    needed = [line for line in metadata.requires("unproject") or () if "extra ==" not in line]
    names = {re.sub(r"[-_.]+", "-", re.split(r"[<>=!~ ;]", line)[0]).lower() for line in needed}
    assert len(names) >= 10 and names <= set(pins("requirements.lock"))
    for pin in re.split(r"\n(?=\w)", (ROOT / "requirements.lock").read_text())[1:]:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", pin), pin


def test_the_licences_of_what_is_locked_are_told_and_permissive() -> None:
    page = (ROOT / "docs/security.md").read_text().partition("| package | licence |")[2]
    told = dict(re.findall(r"^\| ([\w.-]+) \| ([^|]+) \|$", page, re.MULTILINE))
    told.pop("---", None)
    assert set(told) == set(pins("requirements.lock"))
    for package, licence in told.items():
        parts = re.split(r" AND | OR ", licence)
        assert all(PERMISSIVE.match(part) for part in parts), (package, licence)


def imported(file: Path) -> set[str]:
    """The top-level names of all that a module imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add((node.module or "").split(".")[0])
    return names


def test_only_data_get_and_the_hub_import_what_can_fetch() -> None:
    source = ROOT / "src" / "unproject"
    found = {str(file.relative_to(source)) for file in source.rglob("*.py") if imported(file) & NETWORK}
    assert {name for name in found if not name.startswith(SERVES)} == FETCHES


def test_an_import_within_a_function_is_found(tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text("def f():\n    import urllib.request\n    from http import client\n")
    assert imported(tmp_path / "x.py") == {"urllib", "http"}


def test_a_run_from_training_to_files_asks_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*words: Any, **more: Any) -> Any:
        raise AssertionError("the network was asked")

    for name in ("connect", "connect_ex", "sendto", "bind"):
        monkeypatch.setattr(socket.socket, name, refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    run = str(tmp_path / "run")
    assert main(["train", "digits", "--steps", "2", "--batch", "4", "--quiet", "--out", run]) == 0
    assert main(["evaluate", run, "--n", "10"]) == 0
    assert main(["export", run, "--to", "png", "--out", str(tmp_path / "x.png")]) == 0
