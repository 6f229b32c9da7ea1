"""Run directory: where a run lives on disk, and what can be done with one that exists.

recipe.json        how to build the recipe again, and its full description
environment.json   versions, machine, command
stats.jsonl        one JSON object a line: step, seconds, losses, events
checkpoints/       step-*.safetensors
samples/           a contact sheet over time
verdict.json       whether the run came out well, once its budget is spent
report.html        a page about it; tensorboard/, an event file, if asked for
coarse/            the run directory of what was trained first, at half the size
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .._files import check_encoded, read_json, understood, write_text
from .._types import UserError
from . import event_file
from .description import describe
from .environment import environment
from .recipe import Origin, Recipe

VERDICT = "verdict.json"
BUDGET = ("steps", "minutes")
LISTED = 5
RESTORE = "restore it from a copy, or train again"
ENVIRONMENT, REPORT, COARSE = "environment.json", "report.html", "coarse"
WRITTEN = ("samples", "stats.jsonl", ENVIRONMENT, VERDICT, REPORT, event_file.FOLDER, COARSE, "checkpoints")
"""What a run consists of, besides recipe.json."""


def check_free(path: Path, recipe: Recipe | None = None) -> None:
    """Raise UserError if a new run cannot be made at `path`: it holds one, or the recipe's data, or is a file."""
    check_encoded(path)
    if (path / "recipe.json").exists():
        raise UserError(
            f"{path}: holds a run already; `unproject resume {shlex.quote(str(path))}` goes on with it, or choose "
            "another --out"
        )
    given = (recipe.origin.arguments if recipe is not None and recipe.origin else {}).get("data")
    if isinstance(given, dict) and path.is_dir() and os.path.realpath(str(given.get("path"))) == os.path.realpath(path):
        raise UserError(f"{path}: is the folder of the data, to which a run adds pictures; choose another --out")
    if any((path / "checkpoints").glob("step-*")):
        raise UserError(
            f"{path}: holds checkpoints of a run without its recipe.json; remove them, or choose another --out"
        )
    if path.exists() and not path.is_dir():
        raise UserError(f"{path}: is a file; choose another --out")
    foreign = next((name for name in WRITTEN if _is_foreign(path / name)), None)
    if foreign is not None:
        raise UserError(f"{path / foreign}: is there already, and a run would overwrite it; choose another --out")


def _is_foreign(place: Path) -> bool:
    """Whether something is there that is more than what a start leaves that was killed before there was recipe.json."""
    if place.is_dir():
        return any(place.iterdir())
    return place.exists() and not (place.name == ENVIRONMENT and _is_environment(place))


def threads_of(path: Path) -> int | None:
    """Return how many threads the run began with; None if its environment.json is missing or does not tell."""
    with suppress(UserError, OSError):
        found = read_json(path / ENVIRONMENT, RESTORE)
        count = found.get("threads") if isinstance(found, dict) else None
        return count if isinstance(count, int) and count >= 1 else None
    return None


def _is_environment(file: Path) -> bool:
    with suppress(UserError):
        found = read_json(file, RESTORE)
        return isinstance(found, dict) and {"command", "packages"} <= found.keys()
    return False


def content_of(recipe: Recipe, start: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return what recipe.json holds; `start` says which run it begins with.

    Raises:
        UserError: if a part of the recipe cannot be described.
    """
    given = {} if start is None else {"start": start}
    return {**asdict(recipe.origin or Origin("", "", {})), **given, "resolved": describe(recipe)}


def create(path: Path, content: dict[str, Any]) -> None:
    """Lay out a new run directory; recipe.json, which makes a run of it, comes last."""
    for folder in ("checkpoints", "samples"):
        (path / folder).mkdir(parents=True, exist_ok=True)
    write_json(path / ENVIRONMENT, environment())
    write_json(path / "recipe.json", content)


def remove_begun(path: Path) -> None:
    """Remove what `create` and a training made in which nothing was learned, unless it has weights to go on from.

    None of it was there before (`check_free`). recipe.json goes last: what is left of it by a kill can be resumed.
    """
    if any((path / "checkpoints").iterdir()) or (path / COARSE).exists():
        return
    for name in WRITTEN:
        if (path / name).is_dir():
            shutil.rmtree(path / name, ignore_errors=True)
        else:
            (path / name).unlink(missing_ok=True)
    (path / "recipe.json").unlink(missing_ok=True)
    with suppress(OSError):  # something else is there
        path.rmdir()


def remove_temporaries(path: Path) -> None:
    """Remove what a killed process was writing: each may be as large as a checkpoint.

    Ours are named as in `atomic_path`; safetensors writes through a temporary file of its own, .tmp and six signs.
    """
    for pattern in (".*.tmp.*", ".tmp??????"):
        for temporary in path.rglob(pattern):
            temporary.unlink(missing_ok=True)


def write_json(path: Path, value: Any) -> None:
    write_text(path, json.dumps(value, indent=1) + "\n")


def _instead(path: Path) -> str:
    """What there is in its place."""
    if not path.exists():
        fresh = "; `unproject studio --example` makes it" if path.name == "example-chairs" else ""
        return f"there is no such folder{fresh}"
    runs = sorted(file.parent.name for file in path.glob("*/recipe.json"))[:LISTED] if path.is_dir() else []
    return "no recipe.json" + (f", but those of {', '.join(runs)} below" if runs else "")


def read_recipe(path: Path) -> dict[str, Any]:
    """recipe.json. Raises UserError if `path` is no run or the file is damaged."""
    file = path / "recipe.json"
    if not file.is_file():
        raise UserError(f"{path}: not a run directory ({_instead(path)}); give the folder that `--out` named")
    content = read_json(file, RESTORE)
    with understood(file, RESTORE):
        for name, kind in (("recipe", str), ("arguments", dict), ("resolved", dict)):
            if not isinstance(content[name], kind):
                raise TypeError(f"its {name!r} is no {kind.__name__}")
        return {name: content[name] for name in ("recipe", "arguments", "resolved")} | {
            "function": str(content.get("function", "")),
            "start": content.get("start"),
        }


def read_log(file: Path) -> list[dict[str, Any]]:
    """Return the lines of stats.jsonl. Raises UserError if one is damaged."""
    with understood(file, "remove the damaged lines"):
        return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
