"""A figure's report: Markdown, HTML with its pictures inside, and one picture; all from what is kept."""

from __future__ import annotations

import base64
import html
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from .._files import atomic_path
from .figure import Better, Figure
from .judging import Judged, Report
from .kept import Kept
from .slips import DEVIATIONS, SLIPS
from .sources import COLLECTIONS

LABEL, GAP, WIDEST = 22, 12, 1600


def write(report: Report, folder: Path) -> tuple[Path, ...]:
    """FIGURE.md, FIGURE.html and FIGURE.webp in a folder."""
    name = report.figure.name
    picture = folder / f"{name}.webp"
    shown = save_picture(report, picture)
    blocks = blocks_of(report, picture if shown else None)
    texts = {folder / f"{name}.md": markdown(blocks), folder / f"{name}.html": page(report.figure.title, blocks)}
    for path, text in texts.items():
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return (*texts, *((picture,) if shown else ()))


def write_summary(reports: Sequence[Report], path: Path, pages: str = "") -> None:
    """One page of Markdown: every claim and its margin at each seed, deviations, the paper's slips, how it was made.

    Args:
        pages: the folder of the figures' own pages, as seen from this one; ends in a slash unless empty.
    """
    rows = [["figure", "claim", "measured by", MEASURED, MARGIN, "verdict"]]
    for report in reports:
        name = f"[{report.figure.name.replace('fig', 'Fig. ')}]({pages}{report.figure.name}.md)"
        rows.append([name, report.figure.claim, "", "", "", report.verdict])
        for judged in report.judged:
            rows.append(["", judged.text, ", ".join(judged.claim.scores), *_numbers(judged)])
    arms = {key: kept for report in reports for key, kept in report.kept.items()}
    better: dict[str, Better] = {score: which for report in reports for score, which in report.figure.scores.items()}
    blocks: list[Block] = [
        ("heading", "The figures of the paper's supplemental material, reproduced"),
        ("text", HOW_TO_READ),
        ("table", rows),
        ("text", STRUCTURES_SHOWN.format(pages=pages)),
        ("section", "Scores"),
        ("list", protocols(arms.values(), better)),
        ("section", "Deviations from the paper"),
        ("list", [*DEVIATIONS, *own_deviations([report.figure for report in reports])]),
        ("section", "Slips of the paper, and what is left open"),
        ("list", list(SLIPS)),
        ("section", "Real collections"),
        ("text", REAL_COLLECTIONS),
        ("list", [f"`{path}`: {what}" for path, what in COLLECTIONS.items()]),
        ("section", "How it was made"),
        ("text", HOW_MADE),
        ("table", made_rows(arms)),
    ]
    with atomic_path(path) as temporary:
        temporary.write_text(markdown(blocks), encoding="utf-8")


HOW_TO_READ = (
    "The paper is Li, Dong, Peers, Tong, CVPR 2019. The figures of its supplemental material have no numbers: what a "
    "claim asks for is this project's, and a claim that does not name the paper's recipe is about this project's. "
    "*Score* is of each arm that is compared, the geometric mean over seeds, and over scores where there are several. "
    "Chamfer and Fréchet distances are squared ones, as is usual. *Margin* is how many times better than what is asked "
    "for a score is: 1 just meets it, and where at most a third of a distance is asked for, 1.5 is 4.5 times nearer. "
    "A claim holds, or does not, if the mean logarithm of its margins is farther from 0 than seeds spread: "
    "Student's t test, five per cent on either side, with the variance of the score's logarithm between the seeds of "
    "an arm, pooled over the figure's arms that are scored against the same things. It is undecided otherwise, with "
    "fewer than two seeds, and where the mean margin is within two per cent of 1. Of twenty claims with nothing to "
    "them chance decides two. `--seeds 3` adds a seed; what is kept is not trained again. "
    "A figure holds if all the paper's claims do. That it does not means: not reproduced here, with this budget."
)
HOW_MADE = (
    "Folders are cut to their names; `unproject reproduce` writes them, and repeats an arm whose result is removed. "
    "A commit that ends in -dirty had changes which were not committed."
)
REAL_COLLECTIONS = (
    "Arms of real collections are trained where `--data` is given: a folder with any of these. Arms whose file is "
    "missing fail, each with a line that says so; the others are finished."
)
SCORE_TABLE = (
    "Scores are the mean over seeds, in brackets each seed's. Beside the arms: truth, what other true things score, "
    "which is the best to be had; shuffled, these with their maps exchanged between materials."
)
STRUCTURES_SHOWN = (
    "[Fig. 1]({pages}fig1.txt) and [Fig. 6]({pages}fig6.txt) of the paper are network structures; there they are as "
    "this project builds them, of the paper's sizes."
)
MEASURED = "score"
MARGIN = "margin, by seed"


def margins(judged: Judged) -> str:
    """How many times better than asked for at each seed; 1 just meets it."""
    return ", ".join(f"{math.exp(effect):.2f}" for effect in judged.effects) or "not measured"


def own_deviations(figures: Iterable[Figure]) -> list[str]:
    """Each deviation once, after the figures that it is of."""
    of: dict[str, list[str]] = {}
    for figure in figures:
        for line in figure.deviations:
            of.setdefault(line, []).append(figure.name.removeprefix("fig"))
    return [f"{'Fig.' if len(names) == 1 else 'Figs.'} {', '.join(names)}: {line}" for line, names in of.items()]


def measured(judged: Judged) -> str:
    """The score that a claim is about, of each arm that it names, the geometric mean over seeds."""
    return ", ".join(f"{arm} {value:.3g}" for arm, value in judged.measured.items())


def _numbers(judged: Judged) -> list[str]:
    return [measured(judged), margins(judged), judged.said]


def protocols(results: Iterable[Kept], better: Mapping[str, Better]) -> list[str]:
    """What each score measures, as it was measured, and whether more or less of it is better.

    Where it was not measured alike for all arms, each way is followed by the arms that it is of.
    """
    found: dict[str, dict[str, list[str]]] = {name: {} for name in better}
    for kept in results:
        scores = kept.read()["scores"]
        for name in found.keys() & scores.keys():
            found[name].setdefault(scores[name]["protocol"], []).append(kept.arm)
    lines = []
    for name, ways in found.items():
        said = [way if len(ways) == 1 else f"{way} ({', '.join(dict.fromkeys(arms))})" for way, arms in ways.items()]
        lines += [f"{name}, {better[name]} is better: {'; '.join(said)}"] if said else []
    return lines


Block = tuple[str, Any]
"""(kind, content): heading, section, text have a text; list has lines, table rows, the first a head; picture a path."""


def blocks_of(report: Report, picture: Path | None) -> list[Block]:
    figure = report.figure
    blocks: list[Block] = [
        ("heading", f"{figure.name.replace('fig', 'Fig. ')}: {figure.title}"),
        ("text", f"The paper's claim: {figure.claim}"),
        ("text", f"The paper says: {figure.says}"),
        ("text", f"Verdict: {report.verdict}."),
    ]
    if picture is not None:
        blocks += [
            ("picture", picture),
            ("text", f"{figure.caption} Of each arm's first seed, the first ones, none chosen."),
        ]
    blocks += [
        ("table", [["claim", MEASURED, MARGIN, "verdict"], *map(_claim_row, report.judged)]),
        ("text", HOW_TO_READ),
        ("table", score_rows(report)),
        ("text", SCORE_TABLE),
        *([("list", found)] if (found := protocols(report.kept.values(), figure.scores)) else []),
        ("text", "Arms:"),
        ("list", [f"{arm.name}: {arm.says} (`{arm.recipe}`)" for arm in (*figure.arms, *figure.real)]),
    ]
    if figure.deviations:
        blocks += [("text", "Deviations from the paper:"), ("list", list(figure.deviations))]
    return [*blocks, ("text", f"How it was made. {HOW_MADE}"), ("table", made_rows(report.kept))]


def _claim_row(judged: Judged) -> list[str]:
    return [f"{judged.text} ({', '.join(judged.claim.scores)})", *_numbers(judged)]


def score_rows(report: Report) -> list[list[str]]:
    """The figure's scores: the mean over seeds, and each seed's in brackets; then those of true things."""
    columns = list(report.figure.scores)
    rows = [["arm", "minutes", *columns]]
    for arm in (*report.figure.arms, *report.figure.real):
        contents = [report.kept[arm.name, seed].read() for seed in report.seeds(arm.name)]
        if contents:
            minutes = ", ".join(f"{c['seconds'] / 60:.1f}" for c in contents)
            rows.append([arm.name, minutes, *(_cell(contents, column) for column in columns)])
    for name, kept in report.truths.items():
        rows.append([name, "", *(_cell([kept.read()], column) for column in columns)])
    return rows


def _cell(contents: Sequence[dict[str, Any]], score: str) -> str:
    values = [c["scores"][score]["value"] for c in contents if score in c["scores"]]
    if not values:
        return ""
    each = ", ".join(f"{v:.3g}" for v in values)
    return f"{mean(values):.3g}" + (f" ({each})" if len(values) > 1 else "")


def made_rows(arms: Mapping[tuple[str, int], Kept]) -> list[list[str]]:
    rows = [["arm", "seed", "command", "steps", "minutes", "commit", "when", "machine"]]
    for (arm, seed), kept in sorted(arms.items()):
        content = kept.read()
        made = content["environment"]
        machine = f"{made['cuda'] or made['processor']}, {made['cpus']} cores, {made['threads']} threads"
        command = " ".join(("unproject", *made["command"][1:]))
        took = [str(content["steps"]), f"{content['seconds'] / 60:.1f}", str(made["commit"]), made["started"][:10]]
        rows.append([arm, str(seed), f"`{command}`", *took, machine])
    return rows


def markdown(blocks: Sequence[Block]) -> str:
    lines: list[str] = []
    for kind, value in blocks:
        if kind in ("heading", "section"):
            lines.append(f"{'#' if kind == 'heading' else '##'} {value}")
        elif kind == "list":
            lines.append("\n".join(f"- {line}" for line in value))
        elif kind == "table":
            head, *rows = ["| " + " | ".join(row) + " |" for row in value]
            lines.append("\n".join([head, "|---" * len(value[0]) + "|", *rows]))
        else:
            lines.append(f"![{value.stem}]({value.name})" if kind == "picture" else value)
    return "\n\n".join(lines) + "\n"


STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;display:block;overflow-x:auto;font-size:14px}"
    "td,th{border-bottom:1px solid #ddd;padding:.3rem .7rem;text-align:left}img{max-width:100%}"
)


def page(title: str, blocks: Sequence[Block]) -> str:
    """One file that needs no other: pictures are inside."""
    body: list[str] = []
    for kind, value in blocks:
        if kind == "heading":
            body.append(f"<h1>{_rich(value)}</h1>")
        elif kind == "list":
            body.append("<ul>" + "".join(f"<li>{_rich(line)}</li>" for line in value) + "</ul>")
        elif kind == "table":
            cells = [[_rich(cell) for cell in row] for row in value]
            head = "".join(f"<th>{cell}</th>" for cell in cells[0])
            rest = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in cells[1:])
            body.append(f"<table><tr>{head}</tr>{rest}</table>")
        elif kind == "picture":
            content = base64.b64encode(value.read_bytes()).decode()
            body.append(f'<img alt="{value.stem}" src="data:image/webp;base64,{content}">')
        else:
            body.append(f"<p>{_rich(value)}</p>")
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{STYLE}</style><body>{''.join(body)}</body></html>\n"
    )


def _rich(text: str) -> str:
    """Of Markdown what reports use: `code` and *emphasis*."""
    return re.sub(r"\*(\w+)\*", r"<em>\1</em>", re.sub("`([^`]*)`", r"<code>\1</code>", html.escape(text)))


def save_picture(report: Report, path: Path) -> bool:
    """True things and the first seed's of each arm beside one another, each under its name; False if there are none."""
    shown = report.figure.shows
    sheets: dict[str, Path] = {}
    for arm in (*report.figure.arms, *report.figure.real):
        truth = f"truth-{arm.source}"
        if shown == "things" and truth in report.truths:
            sheets[truth] = report.truths[truth].picture
        for seed in report.seeds(arm.name)[:1]:
            kept = report.kept[arm.name, seed]
            sheets[arm.name] = kept.picture if shown == "things" else kept.views
    sheets = {name: sheet for name, sheet in sheets.items() if sheet.exists()}
    if not sheets:
        return False
    with atomic_path(path) as temporary:
        _together(sheets).save(temporary)
    return True


def _together(paths: Mapping[str, Path]) -> Image.Image:
    """Pictures under their names, in rows no wider than WIDEST."""
    rows: list[list[tuple[str, Image.Image]]] = [[]]
    for name, path in paths.items():
        with Image.open(path) as stored:
            picture = stored.convert("RGB")
        picture.thumbnail((WIDEST, picture.height))
        if rows[-1] and _width([*rows[-1], (name, picture)]) > WIDEST:
            rows.append([])
        rows[-1].append((name, picture))
    heights = [LABEL + max(picture.height for _, picture in row) for row in rows]
    sheet = Image.new("RGB", (max(map(_width, rows)), sum(heights)), "white")
    draw, font, top = ImageDraw.Draw(sheet), ImageFont.load_default(size=14), 0
    for row, height in zip(rows, heights, strict=True):
        left = 0
        for name, picture in row:
            draw.text((left + 2, top + 3), name, "black", font)
            sheet.paste(picture, (left, top + LABEL))
            left += picture.width + GAP
        top += height
    return sheet


def _width(row: Sequence[tuple[str, Image.Image]]) -> int:
    return sum(picture.width + GAP for _, picture in row) - GAP
