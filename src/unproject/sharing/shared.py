"""Shared: what others need of a run: a run directory like any, without optimisers, discriminators, and paths.

Its checkpoint has the averaged generator, and what each panel's assignment learned of views, so that it can be sampled,
exported, explored and fitted, but not resumed. Floats have 16 bits, labels of views 8 where they fit.
"""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Mapping
from importlib.resources import files
from os import PathLike
from pathlib import Path, PureWindowsPath
from typing import Any

import torch
from torch import Tensor

from .._files import filled_folder, naming, read_json, write_text
from .._types import UserError
from ..training import Run, load
from ..training import checkpoint as checkpoints
from ..training.run_directory import RESTORE, VERDICT, write_json
from .card import CARD, card_of

EXAMPLES = ("chairs",)
"""Runs that come with the package."""
LOG, LINES = "stats.jsonl", 200
"""The log, and lines of it that are shared at most."""
PLACES = ("recipe.json", "environment.json", VERDICT)


def example_path(name: str) -> Path:
    """Return the directory of a run that comes with the package.

    Raises:
        UserError: if there is none of that name.
    """
    path = Path(str(files("unproject.sharing") / "examples" / name))
    if name not in EXAMPLES or not path.is_dir():
        raise UserError(f"{name}: no run of that name comes with the package; choose from {', '.join(EXAMPLES)}")
    return path


def put_example(name: str, folder: Path) -> Path:
    """Copy a run that comes with the package into a folder of runs, unless it is there; return its directory.

    Raises:
        UserError: if there is none of that name, or the folder is a run itself, in which no others are looked for.
    """
    if (folder / "recipe.json").is_file():
        raise UserError(f"{folder}: is a run itself, in which no other is seen; give the folder that holds runs")
    path = folder / f"example-{name}"
    if not (path / "recipe.json").is_file():
        with filled_folder(path) as staging:
            shutil.copytree(example_path(name), staging, dirs_exist_ok=True)
    return path


def save_pretrained(run: Run | str | PathLike[str], folder: str | PathLike[str], trust: bool = False) -> Path:
    """Write a run for others into a new folder: weights, recipe, verdict, the last picture, and a model card.

    Paths in recipe.json and environment.json are shortened to their last part.

    Args:
        run: the run, or its directory.
        folder: to make.
        trust: import code outside this package.

    Raises:
        UserError: if there is no run, or the folder holds something already.

    Examples:
        >>> import unproject as up
        >>> shared = up.sharing.save_pretrained(up.from_pretrained("chairs"), "shared")
        >>> up.from_pretrained(shared).sample(1).shape
        torch.Size([1, 32, 32, 32])
    """
    opened = run if isinstance(run, Run) else load(Path(run), trust=trust)
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserError(f"{folder}: is not empty; give another --out")
    with naming(folder), filled_folder(folder) as staging:
        _fill(staging, opened, folder.resolve().name)
    return folder


def _fill(folder: Path, opened: Run, title: str) -> None:
    file = checkpoints.checkpoint_of(opened.path / "checkpoints", opened.step)
    if not file.is_file():
        raise UserError(f"{opened.path}: its training has gone on and removed step {opened.step}; load the run again")
    tensors = {name: small(value) for name, value in checkpoints.load(file).items() if is_shared(name)}
    (folder / "checkpoints").mkdir()
    checkpoints.save(folder / "checkpoints", opened.step, tensors)
    for place in PLACES:
        if (opened.path / place).is_file():
            content = read_json(opened.path / place, RESTORE)
            if not isinstance(content, dict):
                raise UserError(f"{opened.path / place}: damaged (holds no object); {RESTORE}")
            if place != VERDICT or content.get("step", opened.step) == opened.step:
                write_json(folder / place, without_paths(content))
    _copy_preview(opened, folder)
    _copy_log(opened, folder / LOG)
    write_text(folder / CARD, card_of(opened, folder, title))


def _copy_preview(opened: Run, folder: Path) -> None:
    (folder / "samples").mkdir(exist_ok=True)
    found = sorted((opened.path / "samples").glob("step-*.png"))
    for picture in [file for file in found if checkpoints.step_of(file) <= opened.step][-1:]:
        shutil.copyfile(picture, folder / "samples" / picture.name)


def _copy_log(opened: Run, file: Path) -> None:
    """Copy losses over time up to the run's step, a few hundred lines of them: events hold one number a picture."""
    source = opened.path / LOG
    if source.is_file():
        text = source.read_text(encoding="utf-8", errors="replace")  # a damaged line is passed over
        lines = [line for line in text.splitlines(keepends=True) if _step_of(line) <= opened.step]
        rows = range(0, len(lines), -(-len(lines) // LINES) or 1)
        write_text(file, "".join(lines[row] for row in rows))


def _step_of(line: str) -> float:
    """Return the step of losses; of an event none, and of a damaged line 0: the copy's reader passes over it."""
    try:
        found = json.loads(line)
        step = math.inf if "event" in found else found["step"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return 0.0
    return step if isinstance(step, (int, float)) else 0.0


def is_shared(name: str) -> bool:
    """Whether others need a tensor of a checkpoint.

    Examples:
        >>> is_shared("average/bias"), is_shared("panels/0/optimisers/online/3"), is_shared("generator/bias")
        (True, False, False)
    """
    part = name.split("/")
    return part[0] == "average" or (part[0] == "panels" and part[2] == "assignment")


def small(value: Tensor) -> Tensor:
    """Return a tensor in 16 bits, and labels in 8 if all of them fit: loading brings them back to their own type."""
    if value.dtype == torch.float32 and value.numel() > 1 and value.abs().max() < torch.finfo(torch.float16).max:
        return value.half()
    if value.dtype == torch.int64 and value.numel() > 1 and int(value.min()) >= 0 and int(value.max()) < 256:
        return value.byte()
    return value


def without_paths(value: Any) -> Any:
    """Return a JSON value whose paths are shortened to their last part.

    A run may have been trained on another system than that which shares it: paths are those of either. Of a `command`,
    and of the `arguments` of a recipe, everything with a separator is one; elsewhere what has a root, or begins with
    `.`, `~` or `file:`, since generators are built again from what is there.

    Examples:
        >>> without_paths({"data": "/data/secret/masks", "rate": 0.1})
        {'data': 'masks', 'rate': 0.1}
        >>> without_paths({"data": "C:\\\\Users\\\\me\\\\masks"})
        {'data': 'masks'}
        >>> without_paths({"command": ["unproject", "train", "shapes", "--data=../lr=1/masks"]})
        {'command': ['unproject', 'train', 'shapes', '--data=masks']}
        >>> without_paths({"recipe": "mine:scans", "arguments": {"data": "clients/acme/masks"}})
        {'recipe': 'mine:scans', 'arguments': {'data': 'masks'}}
    """
    return _without_paths(value, everywhere=False)


def _without_paths(value: Any, everywhere: bool) -> Any:
    if isinstance(value, Mapping):
        # A generator, which a shared run is built from, has a `call` beside its arguments.
        given = {"command"} if "call" in value else {"command", "arguments"}
        return {name: _without_paths(part, everywhere or name in given) for name, part in value.items()}
    if isinstance(value, list):
        return [_without_paths(part, everywhere) for part in value]
    if isinstance(value, str) and (everywhere or _is_path(value)):
        return _short_word(value)
    return value


def _is_path(text: str) -> bool:
    """Whether a text is a path for sure; PureWindowsPath takes / and \\ for separators."""
    return bool(PureWindowsPath(text).root or re.match(r"(\.{0,2}|~[^/\\]*|file:)[/\\]", text))


def _short_word(word: str) -> str:
    flag, sign, path = word.partition("=") if re.match("-[^=]*=", word) else ("", "", word)
    return flag + sign + re.split(r"[/\\]", path.rstrip("/\\"))[-1]
