"""`unproject check module:object`."""

from __future__ import annotations

import inspect
import json as json_format
from typing import TYPE_CHECKING, Any

from .._objects import find_object
from .._types import UserError

if TYPE_CHECKING:
    from ..testing import LawResult


def run(part: str, /, *, json: bool = False, seed: int = 0) -> int:
    """Test a part of your own against the laws: a projection, observation, prior or generator.

    The exit status is 0 if every law holds and 1 if one is broken.

    Args:
        part: module:object or path/to/file.py:object. A class or function is called without arguments first;
            of a list or tuple every element is tested.
        json: Print one JSON object instead of a table.
        seed: Of the random inputs that the laws are tried on.
    """
    results = {name: _tried(name, found, seed) for name, found in _parts(part)}
    print(_json(part, results) if json else _table(results))
    return 0 if all(result.passed for laws in results.values() for result in laws) else 1


def _parts(where: str) -> list[tuple[str, Any]]:
    """Every part that is named, with the name to print."""
    found = _made(where, find_object(where))
    if isinstance(found, list | tuple):
        if not found:
            raise UserError(f"{where}: is empty: name a part, or a list of parts, to be tested")
        return [(getattr(part, "name", f"{where}[{i}]"), part) for i, part in enumerate(found)]
    return [(where, found)]


def _made(where: str, found: Any) -> Any:
    if not (inspect.isclass(found) or inspect.isroutine(found)):
        return found
    try:
        return found()
    except Exception as error:
        raise UserError(f"{where}() raised {type(error).__name__}: {error}; name an object made already") from error


def _tried(name: str, part: Any, seed: int) -> list[LawResult]:
    from ..testing import run_laws

    try:
        return run_laws(part, seed)
    except UserError:
        raise
    except Exception as error:
        # Before any law can be tried a part must take, and a prior draw, the inputs to try it on.
        raise UserError(
            f"{name}: making inputs for it raised {type(error).__name__}: {error}; fix that first"
        ) from error


def _table(results: dict[str, list[LawResult]]) -> str:
    lines = []
    for name, laws in results.items():
        broken = sum(not law.passed for law in laws)
        lines += [name, *(f"  {'passed' if law.passed else 'FAILED'}  {law.name:<14} {law.detail}" for law in laws)]
        lines += [f"  {broken} of {len(laws)} laws broken" if broken else f"  all {len(laws)} laws hold"]
    return "\n".join(lines)


def _json(where: str, results: dict[str, list[LawResult]]) -> str:
    parts = {name: [law._asdict() for law in laws] for name, laws in results.items()}
    passed = all(law.passed for laws in results.values() for law in laws)
    return json_format.dumps({"object": where, "passed": passed, "parts": parts})
