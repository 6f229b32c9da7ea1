"""`unproject studio RUNS_DIR`."""

from __future__ import annotations

from pathlib import Path

from ._machine import return_memory
from ._threads import use_threads


def run(
    folder: Path = Path("runs"),
    /,
    *,
    port: int = 8600,
    host: str = "127.0.0.1",
    example: bool = False,
    threads: int | None = None,
    trust: bool = False,
) -> None:
    """Look at runs in a browser: training as it goes, samples, materials, collections, and what is behind a picture.

    The page is served by this machine to this machine alone and loads nothing from elsewhere.

    Args:
        folder: where runs lie, or one run.
        port: of the address (0: any that is free).
        host: the address to listen at. With another one than this machine's own, other machines can ask too, with the
            token of the printed address, which everyone needs; what is sent is not encrypted.
        example: put a trained run of chairs, which comes with the package, beside the others first.
        threads: processor threads (default: one a core that nobody else keeps busy).
        trust: import code of runs although it is not of this package.
    """
    from ..sharing import put_example
    from ..studio import serve

    use_threads(threads)
    return_memory()
    if example:
        put_example("chairs", folder)
    serve(folder, host, port, trust)
