"""Reproduce the paper's figures: train arms, score them, store results, test claims, write reports."""

from __future__ import annotations

from pathlib import Path

from .._objects import nearest
from .._types import UserError
from .claim_results import Report
from .figure import Arm, Claim, Figure, Verdict, overall, verdict
from .figures import FIGURES
from .report import write, write_summary
from .running import Settings, collecting, has_result, score_finished, train_missing
from .scoring import score_truth
from .structure import STRUCTURES, structure

NAMES = (*STRUCTURES, *FIGURES)


def figures_of(name: str) -> tuple[Figure, ...]:
    """Return the figure of this name, or all.

    Raises:
        UserError: there is no such figure.
    """
    if name == "all":
        return tuple(FIGURES.values())
    if name not in FIGURES:
        raise UserError(
            f"there is no figure {name!r}{nearest(name, [*NAMES, 'all'])}; choose {', '.join(NAMES)} or all"
        )
    return (FIGURES[name],)


def arms_of(figure: Figure, settings: Settings) -> tuple[Arm, ...]:
    """Return the arms of the embedded data, and with `--data` those of real collections too."""
    return (*figure.arms, *(figure.real if settings.data else ()))


def report_of(figure: Figure, settings: Settings) -> Report:
    """Return the report of all stored results, of whatever seeds."""
    arms = (*figure.arms, *figure.real)
    results = {(arm.name, seed): result for arm in arms for seed, result in settings.results(arm).items()}
    for arm in arms:
        for seed in settings.results(arm):
            has_result(arm, seed, settings)
    sources = dict.fromkeys(arm.source for arm in arms)
    truths = {truth.arm: truth for source in sources for truth in settings.truths(source).values() if truth.exists}
    return Report(figure, results, truths)


def reproduce(name: str, settings: Settings, seeds: int, out: Path, train: bool = True) -> tuple[Report, ...]:
    """Train and score missing results, one seed after another, and write the reports of a figure, or of all.

    Args:
        name: of the figure, or all.
        settings: folders and share of the machine.
        seeds: trainings of each arm; reports contain every stored seed.
        out: folder of the reports.
        train: whether to train; else finished runs are scored and stored results reported.

    Raises:
        UserError: a training or a score fails (after the reports are written), or there is nothing to report.
    """
    chosen = figures_of(name)
    arms = {arm.name: arm for figure in chosen for arm in arms_of(figure, settings)}
    jobs = [(arm, seed) for seed in range(seeds) for arm in arms.values()]
    failures: list[str] = []
    with collecting(failures):
        (train_missing if train else score_finished)(jobs, settings)
    for source, place in {arm.source: settings.place(arm) for arm in arms.values() if settings.results(arm)}.items():
        with collecting(failures):
            score_truth(source, place, settings.truths(source), {"budget": settings.budget, "size": place.size})
    reports = tuple(report_of(figure, settings) for figure in chosen)
    if not any(report.results for report in reports):
        nothing = f"{settings.results_folder}: holds no results; run without --report to train"
        raise UserError("; ".join(failures) or nothing)
    for report in reports:
        write(report, out)
    if name == "all":
        write_summary(reports, out / "all.md")
    if failures:
        raise UserError("; ".join(failures))
    return reports


__all__ = [
    "FIGURES",
    "NAMES",
    "Arm",
    "Claim",
    "Figure",
    "Report",
    "Settings",
    "Verdict",
    "figures_of",
    "overall",
    "report_of",
    "reproduce",
    "structure",
    "verdict",
    "write",
    "write_summary",
]
