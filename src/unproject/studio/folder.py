"""Folder: the runs below one folder. Nothing else is read: neither `..` nor a link leads out."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from .._types import UserError
from .answers import Missing

DEEPEST, MOST = 4, 2000
"""Folders within one another that are searched, and runs that are listed at most."""


class Folder:
    """Where runs lie.

    Args:
        root: the folder, or one run.

    Raises:
        UserError: if there is no such folder.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise UserError(
                f"{root}: there is no such folder; give the one that holds runs, such as runs/, or add --example"
            )
        self.root = root.resolve()
        self.given = root

    def names(self) -> list[str]:
        """Return the paths of all runs from the folder on, sorted; "." if it is a run itself."""
        found = []
        for path in self._searched(self.root, 0):
            found.append(path.relative_to(self.root).as_posix())
            if len(found) == MOST:
                break
        return sorted(found)

    def _searched(self, path: Path, depth: int) -> Iterator[Path]:
        if (path / "recipe.json").is_file():
            yield path
            return
        if depth == DEEPEST:
            return
        try:
            entries = sorted(os.scandir(path), key=lambda entry: entry.name)
        except OSError:  # not ours to read
            return
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) and not entry.name.startswith("."):
                yield from self._searched(Path(entry.path), depth + 1)

    def run(self, name: str) -> Path:
        """Return the path of a run.

        Raises:
            Missing: if there is none of that name, or it lies elsewhere.
            UserError: if a link in it leads out of the folder.
        """
        try:
            path = (self.root / name).resolve()
            inside = path.is_relative_to(self.root) and (path / "recipe.json").is_file()
        except (OSError, ValueError, RuntimeError):  # a name that no file can have, or links in a circle
            inside = False
        if not inside:
            raise Missing(f"{name}: there is no such run in {self.given}; it may have been moved")
        self._check_links(path, name)
        return self.given if path == self.root else self.given / path.relative_to(self.root)

    def _check_links(self, path: Path, name: str) -> None:
        for folder, folders, files in os.walk(path):
            for entry in (*folders, *files):
                one = os.path.join(folder, entry)
                if os.path.islink(one) and not Path(os.path.realpath(one)).is_relative_to(self.root):
                    where = os.path.relpath(one, path)
                    raise UserError(f"{name}: its {where} is a link out of {self.given}; put a copy in its place")
