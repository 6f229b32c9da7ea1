"""Atomic writing of files, and what is refused before it is read.

A process may be killed and a disk may fill up at any instant. `atomic_path` gives a temporary file in the same folder;
it is renamed to the final name only after it was written completely and synchronised to the disk.

What is read may be a pipe, for which a reader would wait for ever, or a small file that announces an endless content:
`check_regular` and `check_unpacked` refuse them before anything is read or memory is taken.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ._types import UserError

UNPACKED, TIMES = 2**29, 20
"""Bytes in memory that any file may take, and how many more for each byte of it."""


@contextmanager
def atomic_path(final: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path that replaces `final` on success: `with atomic_path(final) as tmp: write(tmp)`.

    Afterwards `final` is the new file, or unchanged. `tmp` is a hidden file in the same folder (created if missing)
    with the same suffix, since writers choose the format by the suffix. An exception in the block, or an error of the
    disk, removes `tmp` and propagates; one of the disk that names no file names `final`.

    Raises:
        UserError: if `final` is a device or a pipe, whose place a file would take: that of /dev/null for all programs.
    """
    final = Path(final)
    check_replaceable(final)
    final.parent.mkdir(parents=True, exist_ok=True)
    temporary = final.with_name(f".{final.stem}.{secrets.token_hex(4)}.tmp{final.suffix}")
    try:
        yield temporary
        _synchronise(temporary)
        os.replace(temporary, final)
    except BaseException as error:
        if isinstance(error, OSError) and error.errno is not None and error.filename in (None, str(temporary)):
            error.filename = str(final)
        temporary.unlink(missing_ok=True)
        raise
    # Some file systems cannot synchronise a folder; the file itself is safe by now.
    with contextlib.suppress(OSError):
        _synchronise(final.parent, os.O_RDONLY)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name a file in an error of the disk that names none, or a temporary one."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and (error.filename is None or ".tmp" in str(error.filename)):
            error.filename = str(path)
        raise


def write_text(path: Path, text: str) -> None:
    """Write text as UTF-8, whole or not at all (`atomic_path`)."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")  # names of files may be no text


def _synchronise(path: Path, mode: int = os.O_RDWR) -> None:
    """Flush a file to the disk: otherwise a rename may reach the disk before the data and leave an empty file.

    Windows flushes only what is open for writing; a folder can be opened only for reading.
    """
    descriptor = os.open(path, mode)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def check_replaceable(path: Path) -> None:
    """Refuse to write where a pipe, a socket or a device is.

    Raises:
        UserError: if one is there.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise UserError(f"{path}: is a pipe, a socket or a device; give the name of a file to write")


def check_encoded(path: Path) -> None:
    """Refuse names that are not UTF-8, which safetensors cannot open.

    Raises:
        UserError: if it is one.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise UserError(f"{path}: its name is not UTF-8; choose another, or rename it") from None


def check_regular(path: str | os.PathLike[str]) -> None:
    """Refuse pipes, sockets and devices, which a reader would wait for.

    Raises:
        UserError: if there is no such file, or it is none of these that end.
    """
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise UserError(f"{path}: there is no such file; check the path") from None
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise UserError(f"{path}: is a pipe, a socket or a device; write what it gives to a file, and name that")


def check_unpacked(path: str | os.PathLike[str], size: int) -> None:
    """Refuse what would take `size` bytes in memory if these are more than 512 MiB and 20 times its file.

    Raises:
        UserError: with both numbers.
    """
    stored = os.stat(path).st_size
    if size > UNPACKED + TIMES * stored:
        raise UserError(
            f"{path}: announces {size / 2**20:.0f} MiB in a file of {stored / 2**20:.3f}, more than {UNPACKED >> 20} "
            f"and {TIMES} times the file; make it smaller, or save arrays as .npy, which are read as they are needed"
        )


@contextmanager
def understood(path: str | os.PathLike[str], fix: str) -> Iterator[None]:
    """Say that a file is damaged, whatever its content makes the block that reads it raise.

    Content that was valid when it was written may be anything by now: of other types, shapes and names, endlessly deep.

    Raises:
        UserError: naming the file and what to do.
    """
    try:
        yield
    except (UserError, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:160]
        raise UserError(f"{path}: damaged ({reason}); {fix}") from error


def read_json(path: Path, fix: str) -> Any:
    """Read a JSON file; what its reader raises becomes a UserError that names the file and what to do."""
    with understood(path, fix):
        return json.loads(path.read_text(encoding="utf-8"))


def is_file_or_broken_link(path: Path) -> bool:
    """Whether a path is a file, or a link to one that is gone: whatever reads it says so. No pipe and no folder is."""
    return path.is_file() or is_broken_link(path)


def is_broken_link(path: Path) -> bool:
    """Whether a path is a link to what is not there."""
    return path.is_symlink() and not path.exists()


def paths_below(folder: Path) -> list[Path]:
    """Return all files and folders below a folder, sorted; linked folders once, and not those they lie in.

    Run directories are left out: a run whose `--out` lies in its data would otherwise find its own samples there.

    Raises:
        OSError: if a folder may not be read, which `Path.rglob` takes for an empty one.
    """
    seen = {os.path.realpath(folder)}

    def new(top: str, name: str) -> bool:
        where = os.path.realpath(os.path.join(top, name))
        if os.path.isfile(os.path.join(where, "recipe.json")) and os.path.isdir(os.path.join(where, "checkpoints")):
            return False
        return where not in seen and not seen.add(where)

    def refuse(error: OSError) -> None:
        raise error

    found = []
    for top, folders, files in os.walk(folder, onerror=refuse, followlinks=True):
        folders[:] = [name for name in sorted(folders) if new(top, name)]
        found += [Path(top, name) for name in (*folders, *files)]
    return sorted(found)


def files_with(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Return the files below a folder whose names end so, in small letters or others, sorted; none if it is no folder.

    Hidden ones and those of hidden folders are left out.

    Raises:
        OSError: if a folder may not be read.
    """
    below = (path for path in paths_below(folder) if path.suffix.lower() in suffixes) if folder.is_dir() else ()
    return [path for path in below if not is_hidden(path, folder) and is_file_or_broken_link(path)]


def is_hidden(path: Path, folder: Path) -> bool:
    """Whether a part of a file's path, below a folder, is hidden, or a folder made by a system that hides it."""
    *folders, name = path.relative_to(folder).parts
    return name.startswith(".") or any(part.startswith((".", "__")) for part in folders)


@contextmanager
def filled_folder(final: Path) -> Iterator[Path]:
    """A hidden folder to fill on the same disk, whose content then moves to `final`; an error removes it."""
    final = final.absolute()
    exists = final.exists()
    staging = (final if exists else final.parent) / f".{final.name}.{secrets.token_hex(4)}.tmp"
    staging.mkdir(parents=True)
    try:
        yield staging
        if exists:
            if blocked := next((f for f in files_below(staging) if (final / f).is_dir()), None):
                raise UserError(f"{final / blocked}: is a folder where a file is to be written; remove it")
            for file in files_below(staging):
                (final / file).parent.mkdir(parents=True, exist_ok=True)
                os.replace(staging / file, final / file)
        else:
            os.replace(staging, final)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def files_below(folder: Path) -> list[Path]:
    """Files below a folder, relative to it, in order; a folder's note after its pictures."""
    found = (file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    return sorted(found, key=lambda file: (file.parent, file.suffix == ".json", file.name))
