"""Write docs/reproduction.md and the figures' pages from the results stored beside them; nothing is trained.

    python tools/reproduction_page.py

The results are those that `unproject reproduce all --out docs/results/reproduction` wrote.
"""

from __future__ import annotations

from pathlib import Path

from unproject.reproduce import FIGURES, Settings, report_of, write, write_summary

DOCS = Path(__file__).parent.parent / "docs"
BUDGET = "cpu"
PAGES = f"results/reproduction/{BUDGET}/"


def write_pages(docs: Path) -> None:
    """Write all pages to a folder, from the results in the project's docs."""
    settings = Settings(Path("runs"), DOCS / PAGES / "results", None, BUDGET)
    reports = [report_of(figure, settings) for figure in FIGURES.values()]
    for report in reports:
        write(report, docs / PAGES)
    write_summary(reports, docs / "reproduction.md", PAGES)


if __name__ == "__main__":
    write_pages(DOCS)
