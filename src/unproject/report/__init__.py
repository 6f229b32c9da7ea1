"""Report: one self-contained HTML file about a run: verdict, samples, curves, data, commands, environment."""

from __future__ import annotations

from .writing import write_report

__all__ = ["write_report"]
