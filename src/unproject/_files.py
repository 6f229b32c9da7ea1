"""Files that appear whole or not at all.

A process may be killed and a disk may fill up at any instant. `atomic_path` hands out a temporary sibling,
and only a completely written, synchronised file ever takes the final name.
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
    """`with atomic_path(final) as tmp: write(tmp)`: afterwards `final` is the new file, or what it was before.

    `tmp` lies in the same folder (created if missing), is hidden and keeps the suffix, because writers
    choose the format by it. Any exception from the block, or from the disk, removes `tmp` and propagates.
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
    """Wait until the disk holds it: a rename may otherwise outrun the data and leave an empty file."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
