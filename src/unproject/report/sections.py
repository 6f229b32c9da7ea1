"""Sections: what the page says of a run's files: verdict, views, data, commands, environment."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

from .._types import UserError
from ..training.building import foreign_code
from ..training.checkpoint import has_weights_alone
from .contents import Contents, number
from .curves import HEIGHT, charts_of, draw
from .markup import command, definitions, paragraph, picture, section, text
from .pictures import Picture

WORDS = ("good", "doubtful", "failed")
FEWEST_LABELS, WIDTH = 16, 900
LONGEST = 1e6
"""Minutes at most that a further training is advised: a damaged log may say anything."""


def verdict_section(contents: Contents, training: bool = False) -> str:
    """Return the verdict with its findings, or why there is none, and what is wrong with the run's files.

    Args:
        training: whether the run is known to be still training, so that nothing is wrong with one that is not finished.
    """
    unfinished = [] if training or not contents.unfinished else [contents.unfinished]
    remarks = "".join(f"<li>{text(remark)}</li>" for remark in [*contents.remarks, *unfinished])
    parts = [f'<ul class="remarks">{remarks}</ul>' if remarks else ""]
    if contents.verdict is None:
        said = "No verdict yet." if not contents.complete else "No verdict: `unproject evaluate` judges the run."
        return section("Verdict", *parts, f'<p class="line">{text(said)}</p>', kind="verdict")
    word = _word(contents.verdict.get("word"))
    line = str(contents.verdict.get("line", "")).removeprefix(f"{word}: ")
    parts.append(f'<p class="line"><span class="word {word}">{word}</span>{text(line)}</p>')
    findings = contents.verdict.get("findings")
    found = [(str(k), f) for k, f in findings.items() if isinstance(f, dict)] if isinstance(findings, dict) else []
    found.sort(key=lambda item: -WORDS.index(_word(item[1].get("word"))))
    return section("Verdict", *parts, _table(found) if found else "", kind=f"verdict {word}")


def _word(given: object) -> str:
    return str(given) if given in WORDS else "doubtful"


def _table(found: list[tuple[str, dict[str, Any]]]) -> str:
    head = "<tr><th>finding</th><th></th><th>value</th><th>doubtful at</th><th>failed at</th><th>what it says</th></tr>"
    return f'<table class="findings">{head}{"".join(_row(name, finding) for name, finding in found)}</table>'


def _row(name: str, finding: dict[str, Any]) -> str:
    word = _word(finding.get("word"))
    numbers = "".join(
        f'<td class="value" data-label="{label}">{_rounded(finding.get(key))}</td>'
        for key, label in (("value", "value"), ("doubtful", "doubtful at"), ("failed", "failed at"))
    )
    advice = f'<br><span class="advice">Next: {text(finding["next"])}</span>' if finding.get("next") else ""
    says = f"{text(finding.get('says', ''))}{advice}<br><small>{text(finding.get('protocol', ''))}</small>"
    return f'<tr><td>{text(name)}</td><td><span class="word {word}">{word}</span></td>{numbers}<td>{says}</td></tr>'


def _rounded(value: object) -> str:
    found = number(value)
    return "–" if found is None else f"{found:.3g}" if abs(found) < 1000 else f"{found:,.0f}"


def time_section(frames: list[tuple[int, Picture]], damaged: int) -> str:
    """Return the samples over time: all pictures, of which a slider shows one."""
    remark = paragraph(f"{damaged} pictures of samples/ are damaged and left out.") if damaged else ""
    if not frames:
        return section("Samples over time", remark, paragraph("There are no pictures in samples/ yet."))
    last = len(frames) - 1
    shown = "".join(
        f'<div class="frame" data-step="{step}"{"" if k == last else " hidden"}>{picture(one)}</div>'
        for k, (step, one) in enumerate(frames)
    )
    bar = (
        '<div class="bar"><input type="range" id="time" min="0" step="1" aria-label="step of training">'
        f'<span id="time-label">step {frames[-1][0]:,}</span></div>'
    )
    says = paragraph("The same codes at every step, by the averaged weights.", "small")
    return section("Samples over time", remark, f'<div class="time">{shown}{bar if last else ""}</div>', says)


def curves_section(contents: Contents) -> str:
    """Return the charts of the log."""
    panels = contents.recipe["resolved"].get("panels")
    charts = charts_of(contents.lines, [_panel_name(panel) for panel in panels] if isinstance(panels, list) else [])
    if not charts:
        return section("Training", paragraph("stats.jsonl holds no curve yet."))
    says = paragraph(
        "Means of neighbouring steps; steps that were done again are shown as they were done last.", "small"
    )
    return section("Training", f'<div class="charts">{"".join(map(draw, charts))}</div>', says)


def views_section(contents: Contents) -> str:
    """Return how the views that the training pictures were given are spread; nothing where none were assigned."""
    rounds: dict[int, tuple[float, list[float]]] = {}
    for line in contents.lines:
        views = line.get("views")
        if line.get("event") == "assigned" and isinstance(views, list):
            counts = [number(count) or 0.0 for count in views]
            if len(counts) > 1 and sum(counts) > 0 and min(counts) >= 0:
                rounds[int(number(line.get("panel")) or 0)] = (float(line["step"]), counts)
    if not rounds:
        return ""
    panels = contents.recipe["resolved"].get("panels")
    drawn = []
    for panel, (step, counts) in sorted(rounds.items()):
        labels, unit = views_of(panels, panel, len(counts))
        says = f"{sum(counts):,.0f} pictures at step {step:,.0f}; dashed: an even distribution."
        drawn.append(f'<figure class="chart">{_columns(counts, labels, unit)}</figure>{paragraph(says, "small")}')
    return section("How views are spread", *drawn)


def views_of(panels: object, panel: int, count: int) -> tuple[list[str], str]:
    """Return a label for each view, and what it is in: the middle of its bin in degrees where recipe.json tells it."""
    try:
        observations = panels[panel]["observations"]  # pyright: ignore[reportIndexIssue]
        priors = [o["prior"].get("factors", [o["prior"]])[0] for o in observations]
        degrees = [math.degrees((float(p["low"]) + float(p["high"])) / 2) for p in priors]
        if len(degrees) == count and all(map(math.isfinite, degrees)):
            return [f"{degree:.0f}°" for degree in degrees], f"{priors[0]['name']}, degrees"
    except (TypeError, KeyError, IndexError, ValueError, AttributeError, OverflowError):
        pass
    return [str(k) for k in range(count)], "view"


def _columns(counts: list[float], labels: list[str], unit: str) -> str:
    left, bottom, top = 46, 46, 12
    high = max(counts)
    each, tall = (WIDTH - left - 10) / len(counts), HEIGHT - bottom - top
    every = math.ceil(len(counts) / FEWEST_LABELS)
    parts = []
    for k, (count, label) in enumerate(zip(counts, labels)):
        x, y = left + k * each, HEIGHT - bottom - count / high * tall
        height = HEIGHT - bottom - y
        parts.append(
            f'<rect class="column" x="{x + each * 0.12:.1f}" y="{y:.1f}" width="{each * 0.76:.1f}" '
            f'height="{height:.1f}"><title>{escape(label)}: {count:,.0f}</title></rect>'
        )
        if k % every == 0:
            parts.append(f'<text x="{x + each / 2:.1f}" y="{HEIGHT - bottom + 18}">{escape(label)}</text>')
    even = HEIGHT - bottom - sum(counts) / len(counts) / high * tall
    parts.append(f'<path class="even" d="M{left} {even:.1f}H{WIDTH - 10}"/>')
    parts.append(f'<path class="axis" d="M{left} {HEIGHT - bottom}H{WIDTH - 10}"/>')
    parts += [
        f'<text class="up" x="{left - 6}" y="{HEIGHT - bottom - share * tall + 4:.1f}">{share * high:,.0f}</text>'
        for share in (0, 0.5, 1)
    ]
    parts.append(f'<text class="unit" x="{(left + WIDTH) / 2}" y="{HEIGHT - 6}">{escape(unit)}</text>')
    parts.append(f'<text class="unit" transform="translate(11 {top + tall / 2:.0f}) rotate(-90)">pictures</text>')
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="pictures by view">{"".join(parts)}</svg>'


def data_section(contents: Contents, sheets: list[tuple[str, Picture]], why_none: str) -> str:
    """Return the data sheet: where the training pictures came from, how many there are, and two dozen of them."""
    arguments, resolved = contents.recipe["arguments"], contents.recipe["resolved"]
    source = arguments.get("data")
    source = source.get("path", source) if isinstance(source, dict) else source
    rows: list[tuple[str, object]] = [("from", source or f"the recipe's own ({contents.recipe['recipe']})")]
    panels = resolved.get("panels")
    for panel in panels if isinstance(panels, list) else []:
        rows += _panel_rows(panel)
    shown = "".join(
        f'<figure>{picture(sheet, "pixels")}<figcaption class="small">{text(name)}</figcaption></figure>'
        for name, sheet in sheets
    )
    below = f'<div class="sheets">{shown}</div>' if shown else paragraph(f"Training pictures are not shown: {why_none}")
    return section("Data", definitions(rows), below)


def _panel_name(panel: object) -> str:
    """Return the names of a panel's observations in recipe.json, the first and the last."""
    try:
        names = [str(o["name"]) for o in panel["observations"]]  # pyright: ignore[reportIndexIssue]
        return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]}"
    except (TypeError, KeyError, IndexError):
        return "panel"


def _panel_rows(panel: object) -> Iterable[tuple[str, object]]:
    """Return a line on a panel of recipe.json: how many items of which size, how many held out, by which method."""
    try:
        names = [str(o["name"]) for o in panel["observations"]]  # pyright: ignore[reportIndexIssue]
        data = panel["data"] if isinstance(panel["data"], list) else [panel["data"]]  # pyright: ignore[reportIndexIssue]
        shapes = [part["collection"] for part in data]
        count, size = sum(shape[0] for shape in shapes), " × ".join(str(side) for side in shapes[0][1:])
        method = str(panel["assignment"]["type"]).rpartition(":")[2]  # pyright: ignore[reportIndexIssue]
        out = panel.get("held_out")  # pyright: ignore[reportAttributeAccessIssue]
        kept = f", {out['collection'][0]:,} more held out" if out else ""
        name = _panel_name(panel)
        heads = f", {len(names)} views" if len(names) > 1 else ""
        sums = ", ".join(str(part["sha256"]) for part in data[:3]) + (" …" if len(data) > 3 else "")
        yield name, f"{count:,} of {size}{kept}{heads}, {method}; SHA-256 {sums}"
    except (TypeError, KeyError, IndexError, ValueError, AttributeError):
        yield "panel", "not described in recipe.json"


def commands_section(contents: Contents) -> str:
    """Return what made the run and what can be done with it next."""
    run, made = shlex.quote(str(contents.path)), contents.command
    function = str(contents.recipe.get("function", ""))
    again = " --trust" if function and not function.startswith("unproject.") else ""  # it makes the recipe again
    drawn = " --trust" if foreign_code(contents.path) else ""
    minutes = math.ceil(min(2 * max(contents.seconds, 30) / 60, LONGEST))
    further = f"unproject resume {run}" + (f" --minutes {minutes}" if contents.complete else "")
    goes_on = [command("goes on with it", further + again)]
    if _has_weights_alone(contents.path):
        new, recipe = shlex.quote(f"{contents.path}-more"), shlex.quote(str(contents.recipe.get("recipe", "")))
        goes_on = [command("begins a new run with its weights", f"unproject train {recipe} --from {run} --out {new}")]
    folder, meshes = (shlex.quote(str(contents.path / name)) for name in ("samples.png", "meshes"))
    return section(
        "Commands",
        command("made this run", made) if made else paragraph("environment.json does not tell the command."),
        *goes_on,
        command("scores it", f"unproject evaluate {run}{again}"),
        command("writes more samples", f"unproject export {run} --to png --out {folder}{drawn}"),
        *(
            [command("writes them as meshes", f"unproject export {run} --to glb --n 4 --out {meshes}{drawn}")]
            if contents.kind == "volumes"
            else []
        ),
        command("writes a page like this", f"unproject report {run}{again}"),
    )


def _has_weights_alone(path: Path) -> bool:
    """Whether it is a shared run; a damaged one is not."""
    with suppress(UserError, OSError):
        return has_weights_alone(path / "checkpoints")
    return False


def environment_section(contents: Contents) -> str:
    """Return settings, versions, machine, seed and seconds."""
    e, resolved = contents.environment, contents.recipe["resolved"]
    packages = e.get("packages")
    versions = ", ".join(f"{k} {v}" for k, v in packages.items()) if isinstance(packages, dict) else ""
    cores = f"{e['cpus']} cores, {e.get('threads')} threads" if "cpus" in e else ""
    given = {k: v for k, v in contents.recipe["arguments"].items() if k != "data" and v is not None}
    told = ", ".join(f"{name}={_plain(value)}" for name, value in given.items())
    rows = [
        ("recipe", contents.recipe["recipe"]),
        ("settings", told),
        ("seed", resolved.get("seed")),
        ("steps", f"{contents.step:,}"),
        ("trained for", duration(contents.seconds)),
        ("begun", e.get("started")),
        ("commit", e.get("commit")),
        ("versions", f"Python {e.get('python', '?')}, {versions}"),
        ("machine", e.get("processor")),
        ("", cores),
        ("GPU", e.get("cuda")),
        ("system", e.get("platform")),
        ("run", Path(contents.path).absolute()),
    ]
    return section("Environment", definitions(rows))


def _plain(value: object) -> object:
    return value["path"] if isinstance(value, dict) and set(value) == {"path"} else value


def duration(seconds: float) -> str:
    """Return seconds as a person says them.

    Examples:
        >>> duration(231.7), duration(12.3), duration(7500)
        ('231.7 s (3.9 minutes)', '12.3 s', '7500.0 s (2.1 hours)')
    """
    if seconds < 90:
        return f"{seconds:.1f} s"
    rough = f"{seconds / 60:.1f} minutes" if seconds < 5400 else f"{seconds / 3600:.1f} hours"
    return f"{seconds:.1f} s ({rough})"
