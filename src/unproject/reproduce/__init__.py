"""The seed's figures, reproduced: arms trained, scored and kept, claims judged, reports written."""

from __future__ import annotations

from pathlib import Path

from .._objects import nearest
from .._types import UserError
from .budgets import flags_of
from .figure import Arm, Claim, Figure, Verdict, overall, verdict
from .figures import FIGURES
from .report import Report, write, write_summary
from .running import Where, finish, score_finished, score_truth
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


def report_of(figure: Figure, where: Where, seeds: int) -> Report:
    """From what is kept, whoever computed it."""
    results = {
        (arm.name, seed): where.result(arm, seed) for arm in (*figure.arms, *figure.real) for seed in range(seeds)
    }
    sources = dict.fromkeys(arm.source for arm in (*figure.arms, *figure.real))
    truths = {kept.arm: kept for source in sources for kept in where.truths(source).values() if kept.exists}
    return Report(figure, {key: kept for key, kept in results.items() if kept.exists}, truths)


def reproduce(name: str, where: Where, seeds: int, out: Path, train: bool = True) -> tuple[Report, ...]:
    """Train and score what is missing, a seed after the other, and write the reports of a figure, or of all.

    Without `train`, only what is there is scored and reported.
    """
    chosen = figures_of(name)
    arms = {arm.name: arm for figure in chosen for arm in arms_of(figure, where)}
    jobs = [(arm, seed) for seed in range(seeds) for arm in arms.values()]
    (finish if train else score_finished)(jobs, where)
    for arm in arms.values():
        score_truth(arm.source, flags_of(arm, where.budget)["size"], where)
    reports = tuple(report_of(figure, where, seeds) for figure in chosen)
    for report in reports:
        write(report, out)
    if name == "all":
        write_summary(reports, out / "all.md")
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
