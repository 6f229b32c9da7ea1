"""Atomic writing of files.

A process may be killed and a disk may fill up at any instant. `atomic_path` gives a temporary file in the same folder;
it is renamed to the final name only after it was written completely and synchronised to the disk.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_path(final: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path that replaces `final` on success: `with atomic_path(final) as tmp: write(tmp)`.

    Afterwards `final` is the new file, or unchanged. `tmp` is a hidden file in the same folder (created if missing)
    with the same suffix, since writers choose the format by the suffix. An exception in the block, or an error of the
    disk, removes `tmp` and propagates.
    """
    final = Path(final)
    final.parent.mkdir(parents=True, exist_ok=True)
    temporary = final.with_name(f".{final.stem}.{secrets.token_hex(4)}.tmp{final.suffix}")
    try:
        yield temporary
        _synchronise(temporary)
        os.replace(temporary, final)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    # Some file systems cannot synchronise a folder; the file itself is safe by now.
    with contextlib.suppress(OSError):
        _synchronise(final.parent)


def _synchronise(path: Path) -> None:
    """Flush a file to the disk: otherwise a rename may reach the disk before the data and leave an empty file."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
