"""The report that a training leaves in its run directory."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from ._machine import leads, say

if TYPE_CHECKING:
    from ..training import Run


def leave_report(run: Run, quiet: bool) -> None:
    """Write RUN/report.html, from the leading process; whatever goes wrong is a line of warning: the run is there."""
    if not leads():
        return
    try:
        from ..report import write_report

        written = write_report(run)
    except Exception as error:  # a part of the user's own may fail in any way, and so may the disk
        why = " ".join(str(error).split()) or type(error).__name__
        print(f"warning: no report ({why}); unproject report {run.path} writes it", file=sys.stderr)
        return
    if not quiet:
        say(f"report: {written}")
