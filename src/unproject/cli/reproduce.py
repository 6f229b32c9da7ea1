"""`unproject reproduce FIG`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from .._files import atomic_path
from .._types import UserError

PARALLEL = {"cpu": 2, "gpu": 1}
"""Trainings at a time: two trainings with a core each are done sooner than one after another with both."""


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
    """Train the arms of a figure of the paper's supplemental, score them, judge its claims; fig1, fig6: networks.

    What an arm gave is kept as soon as it is finished, and nothing is computed twice; an arm that was interrupted is
    resumed. Leaves in --out/BUDGET: FIG.md, FIG.html (one file, pictures inside), FIG.webp, and results/, the scores and
    pictures of every arm and seed; for all, also all.md and the networks.

    Args:
        figure: fig1 to fig12, or all.
        budget: cpu: small, about ten minutes and a core an arm; gpu: the sizes of the paper.
        seeds: how often each arm is trained; a verdict needs two.
        data: a folder of real collections, as docs/reproduction.md lists them; the embedded worlds alone unless given.
        out: where reports and results are kept, a folder a budget.
        runs: where the runs are, a folder a budget.
        parallel: trainings at a time; two in the cpu budget and one in the other unless given.
        threads: processor threads of each; an equal share of the cores unless given.
        report: train nothing; write the report of what is there, and score runs that are finished.
    """
    import torch

    from ..reproduce import STRUCTURES, Where, structure
    from ..reproduce import reproduce as go

    cores = os.cpu_count() or 1
    parallel = min(PARALLEL[budget], cores) if parallel is None else parallel
    if min(seeds, parallel, 1 if threads is None else threads) < 1:
        raise UserError(f"--seeds {seeds} --parallel {parallel} --threads {threads}: give at least 1 of each")
    threads = max(1, cores // parallel) if threads is None else threads
    if data is not None and not data.is_dir():
        raise UserError(f"--data {data}: is no folder; give the one that holds the real collections")
    for name in STRUCTURES if figure == "all" else {figure} & set(STRUCTURES):
        text = structure(name)
        with atomic_path(out / budget / f"{name}.txt") as temporary:
            temporary.write_text(text, encoding="utf-8")
        print(text, end="")
    if figure in STRUCTURES:
        return
    torch.set_num_threads(threads)  # for the scores
    where = Where(runs / budget, out / budget / "results", data, budget, parallel, threads)
    for found in go(figure, where, seeds, out / budget, train=not report):
        print(f"{found.figure.name}: {found.verdict}")
        for one in found.judged:
            print(f"  {one.said}: {one.text}")
