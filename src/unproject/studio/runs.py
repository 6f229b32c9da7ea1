"""Runs: the list with pictures, budgets and verdicts; one run as it is now, while it trains too."""

from __future__ import annotations

import io
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image

from .._types import UserError
from ..report import write_report
from ..report.contents import Contents, number, read_contents
from ..report.log import Log
from ..report.sections import commands_section, curves_section, environment_section, verdict_section, views_section
from ..training.checkpoint import why_unreadable
from ..training.lock import is_locked
from .answers import Answer, Missing, Request, of_json, tagged
from .downloads import attachment
from .state import State

STILL = 120.0
"""Seconds without a line in the log after which a run counts as stopped, where locks do not tell."""
LOGS, ACROSS = 4, 400
"""Runs whose logs are kept, and pixels across a chart of one."""
THUMBNAIL = 240
WEBP = "image/webp"


def list_runs(state: State, request: Request) -> Answer:
    """Answer with all runs, the newest first: name, recipe, budget, verdict, picture, or what is wrong."""
    found = [{**_summary(state, name), "training": False} for name in state.folder.names()]
    for run in found:
        run["training"] = _trains(state, run)
    found.sort(key=lambda run: -run["changed"])
    return tagged(of_json({"folder": str(state.folder.given), "runs": found}), request)


def _trains(state: State, summary: dict[str, Any]) -> bool:
    """Whether a run is being written: a process holds its lock."""
    if "kind" not in summary:  # it cannot be read
        return False
    locked = is_locked(state.folder.run(summary["name"]))
    return not summary["complete"] and time.time() - summary["changed"] < STILL if locked is None else locked


def _summary(state: State, name: str) -> dict[str, Any]:
    try:
        path = state.folder.run(name)
        changed = _changed(path)
        return state.kept(("summary", name, changed), lambda: _read(state, path, name, changed), 4096)
    except (UserError, Missing, OSError) as error:
        said = " ".join(str(error).split())
    except Exception as error:  # the files of one run may hold anything, and hide no other
        said = f"damaged ({type(error).__name__}: {error})"
    return {"name": name, "changed": 0.0, "said": said, "picture": None}


def _changed(path: Path) -> float:
    """Return when a run was written last: a new line, picture or verdict is a new state of it."""
    files = (path / name for name in ("stats.jsonl", "samples", "verdict.json", "recipe.json", "checkpoints"))
    return max((file.stat().st_mtime for file in files if file.exists()), default=0.0)


def _contents(state: State, path: Path, name: str) -> Contents:
    """Return what the files of a run hold; of a log that was read before only what was added is read."""
    return read_contents(path, state.kept(("log", name), lambda: Log(path / "stats.jsonl"), LOGS))


def _read(state: State, path: Path, name: str, changed: float) -> dict[str, Any]:
    contents = _contents(state, path, name)
    verdict = contents.verdict or {}
    resolved, unreadable = contents.recipe["resolved"], why_unreadable(path / "checkpoints")
    return {
        "name": name,
        "changed": changed,
        "recipe": contents.recipe["recipe"],
        "kind": contents.kind,
        "step": contents.step,
        "trained": max([contents.step, *(int(number(line["step"]) or 0) for line in contents.lines[-1:])]),
        "first": number(resolved.get("checkpoint_every")),
        "steps": number(resolved.get("steps")),
        "minutes": number(resolved.get("minutes")),
        "seconds": contents.seconds,
        "progress": min(contents.progress, 1.0) if not contents.complete else 1.0,
        "complete": contents.complete,
        "verdict": str(verdict.get("word", "")),
        "line": str(verdict.get("line", "")),
        "picture": contents.previews[-1][0] if contents.previews else None,
        "said": " ".join([*contents.remarks, unreadable]).strip(),
        "unreadable": unreadable,
        "unfinished": contents.unfinished,
    }


def show_run(state: State, request: Request) -> Answer:
    """Answer with one run as it is now: sections of its report, and the steps of which there are pictures."""
    summary = _readable(state, request.text("run"))
    training = _trains(state, summary)
    key = ("sections", summary["name"], summary["changed"], training)
    told = state.kept(key, lambda: _sections(state, summary["name"], training), LOGS)
    return tagged(of_json({**summary, "training": training, **told}), request)


def _sections(state: State, name: str, training: bool) -> dict[str, Any]:
    contents = _contents(state, state.folder.run(name), name)
    sections = {
        "verdict": verdict_section(contents, training),
        "curves": _curves(state, contents, name, training),
        "views": views_section(contents),
        "commands": commands_section(contents),
        "environment": environment_section(contents),
    }
    return {"pictures": [step for step, _ in contents.previews], "sections": sections}


def _curves(state: State, contents: Contents, name: str, training: bool) -> str:
    """Return the curves; while a run trains they are drawn anew once there is more than a pixel of them to draw."""
    count = len(contents.lines)
    drawn = count - count % (1 + count // ACROSS) if training else count
    key = ("curves", name, drawn, training, str(contents.lines[drawn - 1 : drawn]))
    return state.kept(key, lambda: curves_section(contents), LOGS)


def _readable(state: State, name: str) -> dict[str, Any]:
    """Return what is known of a run. Raises UserError if it cannot be read."""
    state.folder.run(name)
    summary = _summary(state, name)
    if "kind" not in summary:
        raise UserError(summary["said"])
    return summary


def newest(state: State, request: Request) -> Answer:
    """Answer with what a run makes, how far it is and of which step its newest weights are."""
    summary = _readable(state, request.text("run"))
    told = {name: summary[name] for name in ("kind", "step", "trained", "first", "unfinished")}
    title = state.folder.run(summary["name"]).resolve().name  # a run that was opened itself is called "."
    return of_json({**told, "title": title, "training": _trains(state, summary)})


def picture(state: State, request: Request) -> Answer:
    """Answer with the picture of samples/ at a step, or the newest; small if `small` is given."""
    name, small = request.text("run"), "small" in request.query
    path = state.folder.run(name) / "samples"
    step = request.text("step", "")
    files = [file for file in sorted(path.glob("step-*.png")) if file.stem[5:].isdecimal()]
    found = [file for file in files if step in ("", str(int(file.stem[5:])))]
    if not found:
        raise Missing(f"{name}: there is no such picture in samples/")
    file = found[-1]
    key = ("picture", name, file.name, file.stat().st_mtime, small)
    return tagged(Answer(state.kept(key, lambda: _webp(file, small)), WEBP), request)


def download_report(state: State, request: Request) -> Answer:
    """Answer with the page that `unproject report` writes of a run, as it is now."""
    name = request.text("run")
    path = state.folder.run(name)

    def written() -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            file = write_report(path, Path(folder) / "report.html", data=False, trust=state.trust)
            return file.read_bytes()

    return attachment(state.compute(written), f"{path.resolve().name}.html")


def _webp(file: Path, small: bool) -> bytes:
    """Return a preview as WebP; a small one is the upper left square of it, where samples begin."""
    try:
        with Image.open(file) as opened:
            shown = opened.convert("RGB")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise UserError(f"{file.name}: damaged ({error}); the run goes on without it") from None
    if small:
        side = min(shown.size)
        shown = shown.crop((0, 0, side, side)).resize((THUMBNAIL, THUMBNAIL), Image.Resampling.LANCZOS)
    content = io.BytesIO()
    shown.save(content, "WEBP", quality=80)
    return content.getvalue()
