"""Write docs/reproduction.md and the figures' pages beside the results that are kept there; nothing is trained.

    python tools/reproduction_page.py

What is kept in docs/results/reproduction is what `unproject reproduce all --out docs/results/reproduction` left there.
"""

from __future__ import annotations

from pathlib import Path

from unproject.reproduce import FIGURES, Report, Where, report_of, write, write_summary

DOCS = Path(__file__).parent.parent / "docs"
BUDGET = "cpu"
PAGES = f"results/reproduction/{BUDGET}/"


def reports() -> tuple[Report, ...]:
    where = Where(Path("runs"), DOCS / PAGES / "results", None, BUDGET)
    return tuple(report_of(figure, where) for figure in FIGURES.values())


def main() -> None:
    found = reports()
    for report in found:
        write(report, DOCS / PAGES)
    write_summary(found, DOCS / "reproduction.md", PAGES)


if __name__ == "__main__":
    main()
