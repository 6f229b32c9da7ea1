"""What is wrong with a command line, in one line that says what to do: tyro's report, shortened."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence

from .._objects import nearest


def in_one_line(box: str) -> str:
    """Return what is wrong: the part of tyro's box below its title and above its first rule, on one line.

    Where letters are not UTF-8 the title stands above a rule of hyphens.
    """
    lines = [line.strip("│ ") for line in box.splitlines()]
    rules = [k for k, line in enumerate(lines) if line[:1] in "╭╰" or (line and not line.strip("─-"))]
    start, end, *_ = *rules, len(lines), len(lines)
    wrong = " ".join(" ".join(lines[start + 1 : end]).split())
    return wrong[:1].lower() + wrong[1:].rstrip(".")


def plainly(wrong: str, flags: Sequence[str]) -> str:
    """Return what is wrong in plain words, with what was perhaps meant.

    Args:
        wrong: what `in_one_line` returns.
        flags: those that there are, without their hyphens.
    """
    if wrong.startswith("unrecognized"):
        return wrong + (_meant_flags(wrong, flags) or _meant_data(wrong, flags))
    choice = re.match(r"invalid choice '(.*)' for argument '(.*)'\. Expected one of \((.*)\)", wrong)
    if choice:
        given, argument, known = choice[1], choice[2], choice[3].replace("'", "").replace(",", "").split()
        return f"{argument} {given!r}: choose from {', '.join(known)}{nearest(given, known)}"
    number = re.match(r"error parsing (--\S+): (could not convert string to float|invalid literal for int)", wrong)
    if number:
        given = wrong[number.end() :].partition(": ")[2]
        return f"{number[1]} {given}: give a {'whole ' if 'int' in number[2] else ''}number"
    several = re.match(r"error parsing (--\S+): Could not find valid parse for arguments: (.*)", wrong)
    if several:
        return f"{several[1]} {several[2]}: these are no values of it"
    missing = _missing(wrong)
    return f"give {' and '.join(missing)}" if missing else wrong


def _missing(wrong: str) -> list[str]:
    """The names of missing arguments, of a list in which each is followed by its help and `(required)`."""
    if not wrong.startswith("missing from"):
        return []
    parts = wrong.partition(": ")[2].split("(required)")[:-1]
    return re.findall(r"(?:^|\n)\s*(--[\w-]+ \S+|\S+)", "\n".join(parts))


def _meant_flags(wrong: str, flags: Sequence[str]) -> str:
    hints = (nearest(flag, flags) for flag in re.findall(r"--([\w-]+)", wrong))
    return next((hint.replace("'", "`--", 1).replace("'", "`") for hint in hints if hint), "")


def _meant_data(wrong: str, flags: Sequence[str]) -> str:
    """A path that stands alone is meant as the data."""
    words = wrong.partition(": ")[2].split(", ")
    paths = [word for word in words if not word.startswith("-") and os.path.exists(word)]
    return f". Perhaps you meant `--data {paths[0]}`" if paths and "data" in flags else ""
