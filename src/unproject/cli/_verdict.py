"""The verdict of a run, on the screen and in its verdict.json."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._machine import leads, say

if TYPE_CHECKING:
    from ..training import Run, Verdict


def verdict_of(run: Run, seed: int = 0) -> Verdict | None:
    """Return the verdict, or say why there is none."""
    try:
        return run.verdict(seed=seed)
    except Exception as error:  # a part of the user's own may fail in any way; what was trained is there all the same
        say(f"no verdict ({type(error).__name__}: {error})")
        return None


def conclude(run: Run, quiet: bool) -> None:
    """Write the verdict of a run whose budget is spent, and say it; the leading process only."""
    from ..training.run_directory import VERDICT, write_json

    if not run.complete or not leads():
        return
    verdict = verdict_of(run)
    if verdict is None:
        return
    if not verdict.findings:
        (run.path / VERDICT).unlink(missing_ok=True)  # of a smaller budget
        say(f"no verdict: {verdict.line}")
        return
    write_json(run.path / VERDICT, {"step": run.step, **verdict.described()})
    if not quiet:
        say(f"verdict: {verdict.line}")


def verdict_table(verdict: Verdict) -> str:
    """Return the verdict and its findings, a line each."""
    width = max((len(finding.name) for finding in verdict.findings), default=0)
    lines = [f"  {f.name:<{width}} {f.word:<8} {f.score.value:9.4f}   {f.says}" for f in verdict.findings]
    return "\n".join([f"verdict: {verdict.line}", *lines])
