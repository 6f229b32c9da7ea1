"""`unproject report RUN --out F.html`."""

from __future__ import annotations

from pathlib import Path

from .._types import UserError
from ._threads import use_threads


def run(
    path: Path,
    /,
    *,
    out: Path | None = None,
    data: bool = True,
    threads: int | None = None,
    trust: bool = False,
) -> None:
    """Write a page about a run: verdict, samples now and over time, curves, views, data, commands, environment.

    It is one HTML file under 5 MB that opens in any browser without a network. A shape in it can be turned, a material
    lit. `train` and `resume` write it at their end.

    Args:
        path: the run directory.
        out: the file to write (default: report.html in the run directory).
        data: show training pictures, for which the data are read, or made, again.
        threads: processor threads (default: one a core that nobody else keeps busy).
        trust: import the run's code although it is not of this package.
    """
    from ..report import write_report

    use_threads(threads)
    if out is not None and out.suffix.lower() not in ("", ".html", ".htm"):
        raise UserError(f"--out {out}: a report is a page; give a name that ends in .html")
    written = write_report(path, out, data=data, trust=trust)
    print(f"{written}: {written.stat().st_size / 1e6:.1f} MB; open it in a browser")
