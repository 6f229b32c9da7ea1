"""`unproject reproduce FIG`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from .._cores import cores
from .._files import write_text
from .._types import UserError

PARALLEL = {"cpu": 2, "gpu": 1}
"""Trainings at a time: two trainings with a core each end sooner than one after another with two cores."""


def run(
    figure: str,
    /,
    *,
    budget: Literal["cpu", "gpu"] = "cpu",
    seeds: int = 2,
    data: Path | None = None,
    out: Path = Path("reproduction"),
    runs: Path = Path("runs/reproduction"),
    parallel: int | None = None,
    threads: int | None = None,
    report: bool = False,
) -> None:
    """Train and score the arms of a figure of the paper, and test its claims; fig1 and fig6 print networks.

    The result of an arm is stored as soon as it is finished and never computed again; an interrupted arm is resumed.
    Writes to --out/BUDGET: FIG.md, FIG.html (one file, pictures inside), FIG.webp, and results/, the scores and
    pictures of every arm and seed; for all, also all.md and the networks.

    Args:
        figure: fig1 to fig12, or all.
        budget: cpu: small, about ten minutes and a core an arm; gpu: the sizes of the paper.
        seeds: trainings of each arm; a verdict needs two.
        data: a folder of real collections, as docs/reproduction.md lists them. Default: the embedded data sets alone.
        out: folder of reports and results, with a folder a budget.
        runs: folder of the runs, with a folder a budget.
        parallel: trainings at a time. Default: 2 in the cpu budget, 1 in the gpu budget.
        threads: processor threads of each training. Default: an equal share of the cores.
        report: train nothing; score finished runs and write the report of all results.
    """
    import torch

    from ..reproduce import STRUCTURES, Settings, structure
    from ..reproduce import reproduce as go

    parallel = min(PARALLEL[budget], cores()) if parallel is None else parallel
    if min(seeds, parallel, 1 if threads is None else threads) < 1:
        raise UserError(f"--seeds {seeds} --parallel {parallel} --threads {threads}: give at least 1 of each")
    threads = max(1, cores() // parallel) if threads is None else threads
    if data is not None and not data.is_dir():
        raise UserError(f"--data {data}: is no folder; give the one that holds the real collections")
    for name in STRUCTURES if figure == "all" else {figure} & set(STRUCTURES):
        text = structure(name)
        write_text(out / budget / f"{name}.txt", text)
        print(text, end="")
    if figure in STRUCTURES:
        return
    torch.set_num_threads(threads)  # of the scores
    settings = Settings(runs / budget, out / budget / "results", data, budget, parallel, threads)
    for found in go(figure, settings, seeds, out / budget, train=not report):
        print(f"{found.figure.name}: {found.verdict}")
        for one in found.claim_results:
            print(f"  {one.verdict_text}: {one.text}")
