"""Answers: what a request says and what is sent back, whatever the server."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._types import UserError

POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""The page loads nothing from elsewhere and runs no script but its own files."""


class Missing(LookupError):
    """There is nothing of that name; the message is for the person who asked."""


class Busy(RuntimeError):
    """Too much is being computed already."""


@dataclass(frozen=True)
class Request:
    """A request.

    Attributes:
        query: name → value.
        body: what was sent.
        known: the tag of the answer that the browser has already.
    """

    query: Mapping[str, str]
    body: bytes = b""
    known: str | None = None

    def text(self, name: str, default: str | None = None) -> str:
        """Return a value. Raises UserError if it is missing and has no default."""
        if name in self.query:
            return self.query[name]
        if default is None:
            raise UserError(f"{name} is missing in the address; open the studio's first page")
        return default

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """Return a number within bounds. Raises UserError if it is none."""
        try:
            value = float(self.query.get(name, default))
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise UserError(f"{name}={self.query[name]}: give a number from {low:g} to {high:g}")
        return value

    def whole(self, name: str, default: int, low: int, high: int) -> int:
        """Return a whole number within bounds. Raises UserError if it is none."""
        value = self.number(name, default, low, high)
        if value != int(value):
            raise UserError(f"{name}={value:g}: give a whole number")
        return int(value)

    def json(self) -> dict[str, Any]:
        """Return the body, a JSON object. Raises UserError if it is none."""
        try:
            found = json.loads(self.body)
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise UserError("the body must be a JSON object")
        return found


@dataclass(frozen=True)
class Answer:
    """An answer: content of a media type, with a status and further headers."""

    content: bytes
    kind: str
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)


def of_json(value: Any, status: int = 200) -> Answer:
    """Return JSON. Numbers that JSON lacks become null."""
    return Answer(json.dumps(_plain(value), separators=(",", ":")).encode(), "application/json", status)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value if isinstance(value, (str, int, bool, type(None))) else str(value)


def tagged(answer: Answer, request: Request) -> Answer:
    """Return the answer with a tag of its content, or that the browser has it already."""
    tag = f'"{hashlib.sha256(answer.content).hexdigest()[:24]}"'
    headers = {**answer.headers, "ETag": tag, "Cache-Control": "no-cache"}
    if request.known == tag:
        return Answer(b"", answer.kind, 304, headers)
    return Answer(answer.content, answer.kind, answer.status, headers)
