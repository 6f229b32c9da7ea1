"""Write docs/reproduction.md and the figures' pages beside the results that are kept there; nothing is trained.

    python tools/reproduction_page.py

What is kept in docs/results/reproduction is what `unproject reproduce all --out docs/results/reproduction` left there.
"""

from __future__ import annotations

from pathlib import Path

from unproject.reproduce import FIGURES, Where, report_of, write, write_summary

DOCS = Path(__file__).parent.parent / "docs"
BUDGET = "cpu"
PAGES = f"results/reproduction/{BUDGET}/"


def write_pages(docs: Path) -> None:
    """All of them into a folder, from what is kept in the project's own."""
    where = Where(Path("runs"), DOCS / PAGES / "results", None, BUDGET)
    reports = [report_of(figure, where) for figure in FIGURES.values()]
    for report in reports:
        write(report, docs / PAGES)
    write_summary(reports, docs / "reproduction.md", PAGES)


if __name__ == "__main__":
    write_pages(DOCS)
