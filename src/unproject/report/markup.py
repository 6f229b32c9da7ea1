"""Markup: the page's frame, its content security policy, and text and pictures as HTML. All text is escaped here."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files

from .pictures import Picture

LONGEST = 2000
"""Characters of one text at most: a command line may be any size."""


def text(value: object) -> str:
    """Return what a value says, escaped for HTML, shortened if it is very long."""
    said = str(value)
    said = said if len(said) <= LONGEST else f"{said[:LONGEST]} … ({len(said)} characters)"
    # What UTF-8 cannot hold, such as a half of a pair in a file's name, would fail when the page is written.
    return escape(said.encode("utf-8", "replace").decode("utf-8"))


def asset(name: str) -> str:
    """Return a script or style sheet of this package."""
    return (files("unproject.report") / "assets" / name).read_text(encoding="utf-8")


def page(title: str, body: Iterable[str], scripts: Sequence[str]) -> str:
    """Return the page: it loads nothing, and only these scripts and this style run in it, whatever the body holds."""
    style = asset("page.css")
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {' '.join(map(_hash, scripts))}; "
        "base-uri 'none'; form-action 'none'"
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f"<title>{text(title)}</title><style>{style}</style></head>\n<body>\n"
        + "\n".join(body)
        + "".join(f"\n<script>{script}</script>" for script in scripts)
        + "\n</body></html>\n"
    )


def _hash(content: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"


def section(title: str, *parts: str, kind: str = "") -> str:
    """Return a section of the page; the parts are HTML."""
    return f'<section class="{kind}"><h2>{text(title)}</h2>\n{"".join(parts)}</section>'


def paragraph(said: object, kind: str = "") -> str:
    return f'<p class="{kind}">{text(said)}</p>'


def picture(shown: Picture, kind: str = "") -> str:
    return (
        f'<img class="{kind}" src="{shown.uri}" width="{shown.width}" height="{shown.height}" alt="{text(shown.says)}">'
    )


def definitions(rows: Iterable[tuple[str, object]]) -> str:
    """Return a list of names and values; those without a value are left out."""
    return f"<dl>{''.join(f'<dt>{text(k)}</dt><dd>{text(v)}</dd>' for k, v in rows if v not in (None, ''))}</dl>"


def command(says: str, words: str) -> str:
    """Return a command with what it does, and a button that copies it."""
    button = f'<button type="button" class="copy" aria-label="copy: {text(says)}">copy</button>'
    return f'<p class="says">{text(says)}</p><div class="command"><pre>{text(words)}</pre>{button}</div>'
