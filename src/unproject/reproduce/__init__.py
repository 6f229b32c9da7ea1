"""The paper's figures, reproduced: arms trained, scored and kept, claims judged, reports written."""

from __future__ import annotations

from pathlib import Path

from .._objects import nearest
from .._types import UserError
from .figure import Arm, Claim, Figure, Verdict, overall, verdict
from .figures import FIGURES
from .judging import Report
from .report import write, write_summary
from .running import Where, finish, is_kept, noting, score_finished
from .scoring import score_truth
from .structure import STRUCTURES, structure

NAMES = (*STRUCTURES, *FIGURES)


def figures_of(name: str) -> tuple[Figure, ...]:
    """The figure of a name, or every one. Raises UserError for an unknown one."""
    if name == "all":
        return tuple(FIGURES.values())
    if name not in FIGURES:
        raise UserError(
            f"there is no figure {name!r}{nearest(name, [*NAMES, 'all'])}; choose {', '.join(NAMES)} or all"
        )
    return (FIGURES[name],)


def arms_of(figure: Figure, where: Where) -> tuple[Arm, ...]:
    """Those of the embedded worlds, and with real collections the others too."""
    return (*figure.arms, *(figure.real if where.data else ()))


def report_of(figure: Figure, where: Where) -> Report:
    """From all that is kept, whoever computed it."""
    arms = (*figure.arms, *figure.real)
    results = {(arm.name, seed): kept for arm in arms for seed, kept in where.results(arm).items()}
    for arm in arms:
        for seed in where.results(arm):
            is_kept(arm, seed, where)
    sources = dict.fromkeys(arm.source for arm in arms)
    truths = {kept.arm: kept for source in sources for kept in where.truths(source).values() if kept.exists}
    return Report(figure, results, truths)


def reproduce(name: str, where: Where, seeds: int, out: Path, train: bool = True) -> tuple[Report, ...]:
    """Train and score what is missing, a seed after the other, and write the reports of a figure, or of all.

    Without `train`, only what is there is scored and reported. Reports are of every seed that is kept.

    Raises:
        UserError: if a training or a score fails, after the reports are written; if there is nothing to report.
    """
    chosen = figures_of(name)
    arms = {arm.name: arm for figure in chosen for arm in arms_of(figure, where)}
    jobs = [(arm, seed) for seed in range(seeds) for arm in arms.values()]
    trouble: list[str] = []
    with noting(trouble):
        (finish if train else score_finished)(jobs, where)
    for source, place in {arm.source: where.place(arm) for arm in arms.values() if where.results(arm)}.items():
        with noting(trouble):
            score_truth(source, place, where.truths(source), {"budget": where.budget, "size": place.size})
    reports = tuple(report_of(figure, where) for figure in chosen)
    if not any(report.kept for report in reports):
        nothing = f"{where.kept}: nothing is kept there; run without --report to train it"
        raise UserError("; ".join(trouble) or nothing)
    for report in reports:
        write(report, out)
    if name == "all":
        write_summary(reports, out / "all.md")
    if trouble:
        raise UserError("; ".join(trouble))
    return reports


__all__ = [
    "FIGURES",
    "NAMES",
    "Arm",
    "Claim",
    "Figure",
    "Report",
    "Verdict",
    "Where",
    "figures_of",
    "overall",
    "report_of",
    "reproduce",
    "structure",
    "verdict",
    "write",
    "write_summary",
]
