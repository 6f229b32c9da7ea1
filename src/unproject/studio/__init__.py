"""Studio: a page on this machine that shows runs, and what they generate, in a browser.

Python's own server is enough: one person asks it for a dozen kinds of answers, none of which is a stream, and all that
takes time waits for one thread that computes. A web framework would add packages and take away none of the checks.
"""

from __future__ import annotations

from .server import Studio, serve

__all__ = ["Studio", "serve"]
