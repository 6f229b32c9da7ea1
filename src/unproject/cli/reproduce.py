"""`unproject reproduce FIG`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from .._types import UserError


def run(
    figure: str,
    /,
    *,
    budget: Literal["cpu", "gpu"] = "cpu",
    seeds: int = 2,
    data: Path | None = None,
    out: Path = Path("reproduction"),
    runs: Path = Path("runs/reproduction"),
    parallel: int = 1,
    threads: int | None = None,
    report: bool = False,
) -> None:
    """Train the arms of a figure of the seed, score them and judge its claims; fig1 and fig6 print the networks.

    What an arm gave is kept as soon as it is finished, and nothing is computed twice; an arm that was interrupted is
    resumed. Leaves in --out: FIG.md, FIG.html (one file, pictures inside), FIG.png, and results/, scores and pictures.

    Args:
        figure: fig1 to fig12, or all.
        budget: cpu: two cores, at most ten minutes an arm; gpu: the sizes of the seed.
        seeds: how often each arm is trained; a verdict needs two.
        data: real collections (MNIST, masks, meshes, probes); the embedded worlds alone unless given.
        out: where reports and results are kept.
        runs: where the runs are.
        parallel: trainings at a time.
        threads: processor threads of each; all cores unless given.
        report: train nothing; write the report of what is there, and score runs that are finished.
    """
    from ..reproduce import STRUCTURES, Where, structure
    from ..reproduce import reproduce as go

    if seeds < 1 or parallel < 1:
        raise UserError(f"--seeds {seeds} --parallel {parallel}: give at least 1 of each")
    if figure in STRUCTURES:
        text = structure(figure)
        out.mkdir(parents=True, exist_ok=True)
        (out / f"{figure}.txt").write_text(text, encoding="utf-8")
        print(text, end="")
        return
    where = Where(runs, out / "results", data, budget, parallel, threads)
    for found in go(figure, where, seeds, out, train=not report):
        print(f"{found.figure.name}: {found.verdict}")
        for one in found.judged:
            print(f"  {one.verdict}: {one.claim.text}")
