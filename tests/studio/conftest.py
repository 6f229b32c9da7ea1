"""Runs that the studio's tests share, and how they ask."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from unproject.cli import main
from unproject.studio.answers import Request
from unproject.studio.server import respond
from unproject.studio.state import State

TOY = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}:toy"
Said = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="package")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one finished run of shapes."""
    folder = tmp_path_factory.mktemp("runs")
    words = ["train", TOY, "--views", "known", "--steps", "2", "--quiet", "--out", str(folder / "toy")]
    assert main(words) == 0
    return folder


@pytest.fixture(scope="package")
def said() -> Said:
    """(status, JSON) of an answer, without a server."""

    def answered(state: State, path: str, method: str = "GET", body: bytes = b"", **query: Any) -> Any:
        answer = respond(state, method, path, Request({k: str(v) for k, v in query.items()}, body))
        return answer.status, json.loads(answer.content)

    return answered
