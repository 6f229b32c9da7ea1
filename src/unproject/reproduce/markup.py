"""Write a list of blocks as Markdown or as one HTML file."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Callable, Sequence
from typing import Any

Block = tuple[str, Any]
"""(kind, content): heading, section, subsection and text: a text; list: lines; table: rows, the first one the head;
picture: a path."""
LEVELS = {"heading": 1, "section": 2, "subsection": 3}


def markdown(blocks: Sequence[Block]) -> str:
    """Return the blocks as Markdown."""
    return "\n\n".join(_markdown(kind, value) for kind, value in blocks) + "\n"


def _markdown(kind: str, value: Any) -> str:
    if kind in LEVELS:
        return f"{'#' * LEVELS[kind]} {value}"
    if kind == "list":
        return "\n".join(f"- {line}" for line in value)
    if kind == "table":
        head, *rows = ["| " + " | ".join(row) + " |" for row in value]
        return "\n".join([head, "|---" * len(value[0]) + "|", *rows])
    return f"![{value.stem}]({value.name})" if kind == "picture" else value


STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;display:block;overflow-x:auto;font-size:14px}"
    "td,th{border-bottom:1px solid #ddd;padding:.3rem .7rem;text-align:left}img{max-width:100%}"
)


def page(title: str, blocks: Sequence[Block]) -> str:
    """Return the blocks as an HTML page that needs no other file: pictures are inside."""
    body = "".join(_html(kind, value) for kind, value in blocks)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{STYLE}</style><body>{body}</body></html>\n"
    )


def _html(kind: str, value: Any) -> str:
    if kind in LEVELS:
        return f"<h{LEVELS[kind]}>{_rich(value)}</h{LEVELS[kind]}>"
    return _HTML.get(kind, lambda text: f"<p>{_rich(text)}</p>")(value)


def _html_list(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{_rich(line)}</li>" for line in lines) + "</ul>"


def _html_table(rows: Sequence[Sequence[str]]) -> str:
    head, *rest = ("".join(f"<{tag}>{_rich(cell)}</{tag}>" for cell in row) for tag, row in _tagged(rows))
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in rest)}</table>"


def _tagged(rows: Sequence[Sequence[str]]) -> list[tuple[str, Sequence[str]]]:
    return [("td" if k else "th", row) for k, row in enumerate(rows)]


def _html_picture(path: Any) -> str:
    content = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="{path.stem}" src="data:image/webp;base64,{content}">'


_HTML: dict[str, Callable[[Any], str]] = {"list": _html_list, "table": _html_table, "picture": _html_picture}


def _rich(text: str) -> str:
    """Return the HTML of the Markdown that reports have: `code` and *emphasis*."""
    return re.sub(r"\*(\w+)\*", r"<em>\1</em>", re.sub("`([^`]*)`", r"<code>\1</code>", html.escape(text)))
