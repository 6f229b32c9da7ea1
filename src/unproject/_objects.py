"""Import of a user's own parts by name: `module:name` or `path/to/file.py:name`.

There is no registry: the command line can use whatever Python can import.
"""

from __future__ import annotations

import sys
from difflib import get_close_matches
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from ._types import UserError


def find_object(where: str) -> Any:
    """Return the object named `module:name` or `path/to/file.py:name`; `name` may be dotted.

    Modules in the current directory are found too; a file may import modules from its own folder.

    Raises:
        UserError: if there is no such file, module or name, or if importing it fails.

    Examples:
        >>> find_object("math:pi")
        3.141592653589793
    """
    source, _, name = where.rpartition(":")
    is_module = all(part.isidentifier() for part in source.split("."))
    if not name or not (source.endswith(".py") or is_module):
        raise UserError(f"{where!r} names no object: write module:name or path/to/file.py:name")
    found: Any = _module_in_file(Path(source)) if source.endswith(".py") else _module_called(source)
    for part in name.split("."):
        if not hasattr(found, part):
            raise UserError(f"{source} has no {part!r}{nearest(part, dir(found))}; name something it defines")
        found = getattr(found, part)
    return found


def import_name(value: Any) -> str:
    """Return under which name `find_object` finds a function or class again.

    `module:name`, or of the script that runs, whose module is called __main__ in this process alone, `file.py:name`.
    """
    file = _running_script()
    if value.__module__ == "__main__" and file is not None:
        return f"{file}:{value.__qualname__}"
    return f"{value.__module__}:{value.__qualname__}"


def module_name(name: str) -> str:
    """Return a module's name, or of the script that runs the one that `find_object` gives its file."""
    file = _running_script()
    return _name_of(file) if name == "__main__" and file is not None else name


def _running_script() -> Path | None:
    file = getattr(sys.modules.get("__main__"), "__file__", None)
    return Path(file) if file is not None and file.endswith(".py") else None


def _name_of(path: Path) -> str:
    return f"_unproject_{path.stem}"


def nearest(name: str, names: Any) -> str:
    """Return ". Perhaps you meant 'x'" with the name closest to `name`, or "" if none is close."""
    close = get_close_matches(name, [n for n in names if not n.startswith("_")], n=1)
    return f". Perhaps you meant {close[0]!r}" if close else ""


def _module_called(name: str) -> ModuleType:
    _add_to_path(Path.cwd())
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise _failed(name, error) from error
        raise UserError(f"there is no module {name!r}: run from its folder, or install it") from error
    except Exception as error:
        raise _failed(name, error) from error


def _module_in_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise UserError(f"{path}: no such file; check the path before the colon")
    name, running = _name_of(path), _running_script()
    if running is not None and running.resolve() == path.resolve():
        sys.modules[name] = sys.modules["__main__"]  # not again: a script that trains would train within itself
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses find their module by name
    _add_to_path(path.resolve().parent)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise _failed(str(path), error) from error
    return module


def _add_to_path(folder: Path) -> None:
    if str(folder) not in sys.path:
        sys.path.append(str(folder))


def _failed(where: str, error: Exception) -> UserError:
    return UserError(f"importing {where} raised {type(error).__name__}: {error}; fix it and try again")
