"""Write the report of a figure, or of all figures, from stored results: Markdown, HTML and one picture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from .._files import write_text
from .claim_results import ClaimResult, Report
from .deviations import SECTIONS
from .errata import ERRATA, LEFT_OPEN
from .figure import Better, Figure
from .markup import Block, markdown, page
from .pictures import save_picture
from .place import COLLECTIONS
from .result import Result

HOW_TO_READ = (
    "The paper is Li, Dong, Peers, Tong, CVPR 2019. The figures of its supplemental material have no numbers: the "
    "thresholds of the claims are this project's, and a claim that does not name the paper's recipe is about this "
    "project's recipe. *Score* is the score of each arm that the claim compares: the geometric mean over seeds, and "
    "over scores where there are several. Chamfer and Fréchet distances are squared: a third of one is 0.58 of the "
    "distance itself. *Margin* is how many times better than the threshold the score is: 1 just meets it, and where "
    "the threshold is a third of a distance, a margin of 1.5 is 4.5 times nearer. A claim holds, or does not hold, if "
    "the mean logarithm of its margins differs from 0 by Student's t test, five per cent on either side, with the "
    "variance of the score's logarithm between the seeds of an arm, pooled over the figure's arms of the same data "
    "except those whose seeds are all alike, as scores at their bound are. "
    "Otherwise it is undecided, as it is with fewer than two seeds and where the mean margin is within two per cent of "
    "1. Beside each verdict stand t, its degrees of freedom in brackets, and p, the chance of such a mean on that side "
    "without any effect. Arms may differ in their variance, which is assumed to be one: a verdict whose p is near 0.05 "
    "depends on it, and on which arms are pooled. *Other commits*: the two arms were trained at different commits, "
    "whose recipes may differ in more than the claim is about; *seeds of several commits*: so were the seeds of one "
    "arm; *other machines*: with other processors or threads, so that equal minutes are other numbers of steps; *times "
    "the minutes*: the first arm was trained for so many times as long as the second. Of twenty "
    "claims without any effect, two are decided by chance. `--seeds 3` adds a seed; stored results are not computed "
    "again. A figure holds if all the paper's claims hold. Where it does not hold, it was not reproduced here, with "
    "this budget."
)
HOW_MADE = (
    "`unproject reproduce` writes these results, and trains an arm again whose result is removed. Paths are shortened "
    "to their last part. Commands are spelled as they were run at their commit: CHANGELOG.md lists the flags "
    "renamed since. A commit that ends in -dirty had uncommitted changes."
)
REAL_COLLECTIONS = (
    "Arms of real collections are trained where `--data` is given: a folder with any of these. An arm whose file is "
    "missing fails with a line that says so; the others are finished."
)
SCORE_TABLE = (
    "Scores are means over seeds, each seed's in brackets. Beside the arms: truth, the score of other true samples, "
    "which is the best to be expected; shuffled, the same with maps exchanged between materials."
)
STRUCTURES_SHOWN = (
    "[Fig. 1]({pages}fig1.txt) and [Fig. 6]({pages}fig6.txt) of the paper are network structures; these files list the "
    "networks as built here, at the paper's sizes."
)
PAPER_ARMS = (
    "Arms with the paper's recipe, which say what it reaches in this budget. The verdicts on the paper's claims "
    "come from them only where the claim names the paper's recipe."
)
DEVIATIONS_SHOWN = (
    "Read line by line against the supplemental material. Modern recipes differ in all of this; what follows is about "
    "the paper's recipes, unless it says otherwise."
)
MEASURED = "score"
MARGIN = "margin, by seed"


def write(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write FIGURE.md, FIGURE.html and FIGURE.webp to a folder; return their paths."""
    name = report.figure.name
    picture = folder / f"{name}.webp"
    shown = save_picture(report, picture)
    blocks = blocks_of(report, picture if shown else None)
    texts = {folder / f"{name}.md": markdown(blocks), folder / f"{name}.html": page(report.figure.title, blocks)}
    for path, text in texts.items():
        _save(path, text)
    return (*texts, *((picture,) if shown else ()))


def write_summary(reports: Sequence[Report], path: Path, pages: str = "") -> None:
    """Write one page of Markdown: every claim, its margins, the paper's arms, deviations, errata and provenance.

    Args:
        pages: the folder of the figures' own pages, relative to this page; ends in a slash unless empty.
    """
    blocks: list[Block] = [
        ("heading", "The figures of the paper's supplemental material, reproduced"),
        ("text", HOW_TO_READ),
        ("table", claim_rows(reports, pages)),
        ("text", STRUCTURES_SHOWN.format(pages=pages)),
        ("section", "Arms with the paper's recipe"),
        ("text", PAPER_ARMS),
        ("table", paper_arm_rows(reports)),
        *_scores(reports),
        *_deviations([report.figure for report in reports]),
        *_provenance(reports),
    ]
    _save(path, markdown(blocks))


def _save(path: Path, text: str) -> None:
    write_text(path, text)


def _results(reports: Iterable[Report]) -> dict[tuple[str, int], Result]:
    return {key: result for report in reports for key, result in report.results.items()}


def _scores(reports: Sequence[Report]) -> list[Block]:
    better: dict[str, Better] = {score: which for report in reports for score, which in report.figure.scores.items()}
    return [("section", "Scores"), ("list", protocols(_results(reports).values(), better))]


def _deviations(figures: Sequence[Figure]) -> list[Block]:
    blocks: list[Block] = [("section", "Deviations from the paper"), ("text", DEVIATIONS_SHOWN)]
    for title, lines in SECTIONS.items():
        blocks += [("subsection", title), ("list", list(lines))]
    blocks += [("subsection", "Single figures"), ("list", own_deviations(figures))]
    blocks += [("section", "Errata of the paper"), ("list", list(ERRATA))]
    return [*blocks, ("section", "Values that the supplemental material leaves open"), ("list", list(LEFT_OPEN))]


def _provenance(reports: Sequence[Report]) -> list[Block]:
    return [
        ("section", "Real collections"),
        ("text", REAL_COLLECTIONS),
        ("list", [f"`{path}`: {what}" for path, what in COLLECTIONS.items()]),
        ("section", "How it was made"),
        ("text", HOW_MADE),
        ("table", made_rows(_results(reports))),
    ]


def claim_rows(reports: Iterable[Report], pages: str) -> list[list[str]]:
    """Return a row for each figure, linked to its page, and under it a row for each claim."""
    rows = [["figure", "claim", "measured by", MEASURED, MARGIN, "verdict"]]
    for report in reports:
        name = f"[{report.figure.label}]({pages}{report.figure.name}.md)"
        rows.append([name, report.figure.claim, "", "", "", report.verdict])
        for one in report.claim_results:
            rows.append(["", one.text, ", ".join(one.claim.scores), *_numbers(one)])
    return rows


def paper_arm_rows(reports: Iterable[Report]) -> list[list[str]]:
    """Return a row for each figure: its arms with the paper's recipe and their seeds, or why it has none."""
    rows = [["figure", "arms", "recipe"]]
    for report in reports:
        arms = [arm for arm in report.figure.arms if arm.of_paper]
        names = ", ".join(f"{arm.name} ({_seeds(report, arm.name)})" for arm in arms)
        recipes = ", ".join(dict.fromkeys(f"`{arm.recipe}`" for arm in arms))
        rows.append([report.figure.label, names or "none", recipes or report.figure.no_paper_arm])
    return rows


def _seeds(report: Report, arm: str) -> str:
    count = len(report.seeds(arm))
    return "not trained yet" if not count else f"{count} seed{'s' if count > 1 else ''}"


def margins(one: ClaimResult) -> str:
    """Return how many times better than the threshold each seed is; 1 just meets it."""
    return ", ".join(f"{math.exp(effect):.2f}" for effect in one.effects) or "not measured"


def measured(one: ClaimResult) -> str:
    """Return the score of each arm that the claim names, the geometric mean over seeds."""
    return ", ".join(f"{arm} {value:.3g}" for arm, value in one.measured.items())


def _numbers(one: ClaimResult) -> list[str]:
    return [measured(one), margins(one), one.verdict_text]


def own_deviations(figures: Iterable[Figure]) -> list[str]:
    """Return each figure's own deviation once, behind the numbers of its figures."""
    of: dict[str, list[str]] = {}
    for figure in figures:
        for line in figure.deviations:
            of.setdefault(line, []).append(figure.name.removeprefix("fig"))
    return [f"{'Fig.' if len(names) == 1 else 'Figs.'} {', '.join(names)}: {line}" for line, names in of.items()]


def protocols(results: Iterable[Result], better: Mapping[str, Better]) -> list[str]:
    """Return the protocol of each score, and whether more or less of it is better.

    Where arms have different protocols, each is followed by its arms.
    """
    found: dict[str, dict[str, list[str]]] = {name: {} for name in better}
    for result in results:
        scores = result.read()["scores"]
        for name in found.keys() & scores.keys():
            found[name].setdefault(scores[name]["protocol"], []).append(result.arm)
    return [f"{name}, {better[name]} is better: {_protocol(arms_of)}" for name, arms_of in found.items() if arms_of]


def _protocol(arms_of: Mapping[str, Sequence[str]]) -> str:
    if len(arms_of) == 1:
        return next(iter(arms_of))
    return "; ".join(f"{protocol} ({', '.join(dict.fromkeys(arms))})" for protocol, arms in arms_of.items())


def blocks_of(report: Report, picture: Path | None) -> list[Block]:
    """Return the blocks of a figure's own page."""
    figure = report.figure
    claims = [["claim", MEASURED, MARGIN, "verdict"], *map(_claim_row, report.claim_results)]
    blocks: list[Block] = [
        ("heading", f"{figure.label}: {figure.title}"),
        ("text", f"The paper's claim: {figure.claim}"),
        ("text", f"The paper says: {figure.paper_says}"),
        ("text", f"Verdict: {report.verdict}."),
        *_picture(figure, picture),
        ("table", claims),
        ("text", HOW_TO_READ),
        ("table", score_rows(report)),
        ("text", SCORE_TABLE),
        *([("list", found)] if (found := protocols(report.results.values(), figure.scores)) else []),
        *_arms(figure),
    ]
    return [*blocks, ("text", f"How it was made. {HOW_MADE}"), ("table", made_rows(report.results))]


def _picture(figure: Figure, picture: Path | None) -> list[Block]:
    if picture is None:
        return []
    of_samples = "The first samples of each arm's first seed, none chosen."
    of_views = "Of each arm's first seed the first training images of each view, none chosen."
    shown = of_samples if figure.shows == "samples" else of_views
    return [("picture", picture), ("text", f"{figure.caption} {shown}")]


def _arms(figure: Figure) -> list[Block]:
    arms = [f"{arm.name}: {arm.description} (`{arm.recipe}`)" for arm in (*figure.arms, *figure.real)]
    blocks: list[Block] = [("text", "Arms:"), ("list", arms)]
    if figure.no_paper_arm:
        blocks.append(("text", f"No arm has the paper's recipe: {figure.no_paper_arm}"))
    if figure.deviations:
        blocks += [("text", "Deviations from the paper in this figure:"), ("list", list(figure.deviations))]
    return blocks


def _claim_row(one: ClaimResult) -> list[str]:
    return [f"{one.text} ({', '.join(one.claim.scores)})", *_numbers(one)]


def score_rows(report: Report) -> list[list[str]]:
    """Return a row for each arm: the mean of each score over seeds and each seed's in brackets; then true samples."""
    columns = list(report.figure.scores)
    rows = [["arm", "minutes", *columns]]
    for arm in (*report.figure.arms, *report.figure.real):
        contents = [report.results[arm.name, seed].read() for seed in report.seeds(arm.name)]
        if contents:
            minutes = ", ".join(f"{c['seconds'] / 60:.1f}" for c in contents)
            rows.append([arm.name, minutes, *(_cell(contents, column) for column in columns)])
    for name, result in report.truths.items():
        rows.append([name, "", *(_cell([result.read()], column) for column in columns)])
    return rows


def _cell(contents: Sequence[dict[str, Any]], score: str) -> str:
    values = [c["scores"][score]["value"] for c in contents if score in c["scores"]]
    if not values:
        return ""
    each = ", ".join(f"{v:.3g}" for v in values)
    return f"{mean(values):.3g}" + (f" ({each})" if len(values) > 1 else "")


def made_rows(arms: Mapping[tuple[str, int], Result]) -> list[list[str]]:
    """Return a row for each training: its command, steps, minutes, commit, date and machine."""
    rows = [["arm", "seed", "command", "steps", "minutes", "commit", "when", "machine"]]
    for (arm, seed), result in sorted(arms.items()):
        content = result.read()
        made = content["environment"]
        machine = f"{made['cuda'] or made['processor']}, {made['cpus']} cores, {made['threads']} threads"
        command = " ".join(("unproject", *made["command"][1:]))
        took = [str(content["steps"]), f"{content['seconds'] / 60:.1f}", str(made["commit"]), made["started"][:10]]
        rows.append([arm, str(seed), f"`{command}`", *took, machine])
    return rows
