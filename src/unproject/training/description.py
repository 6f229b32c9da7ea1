"""A JSON description of a recipe: what recipe.json holds, and what a resumed run must match."""

from __future__ import annotations

import hashlib
import inspect
import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .._objects import module_name
from .._types import UserError
from ..data import Collection
from ..data.lazy import Lazy
from ..data.sampling import spread_rows

MAX_BYTES_READ, SOME = 2**28, 1024
"""Bytes of items in a file beyond which only some are looked at: reading all would take longer than a run's start."""
SKETCHED, ROUNDING = 8, 1e-5
"""Sums in a sketch; and what rounding may change of numbers and, in units of the norm, of sketches: a processor or a
kernel other than before changes 1e-7 of most values, another picture among a million 1e-3."""


def describe(value: Any) -> Any:
    """Return a JSON description of a recipe or of any part of one.

    Raises:
        UserError: if a part is of a type that has none.
    """
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Collection):
        # Not its source: the same data may be reached by another path.
        return {"collection": [len(value), *value.shape], **_digests(value.stored)}
    if isinstance(value, Tensor):
        return {"tensor": list(value.shape), **_digests(value)}
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        return {"array": list(value.shape), **_digests(torch.from_numpy(value.copy()))}
    if isinstance(value, np.generic):
        return describe(value.item())
    if isinstance(value, (torch.dtype, torch.device)):
        return str(value)
    if isinstance(value, (set, frozenset)):
        return sorted(map(describe, value), key=repr)
    if isinstance(value, partial):
        return _call(value.func, value.keywords, value.args)
    if is_dataclass(value) and not isinstance(value, type):
        shown = [f.name for f in fields(value) if _shown(f.metadata.get("described", True), getattr(value, f.name))]
        return {"type": full_name(type(value)), **{name: describe(getattr(value, name)) for name in shown}}
    if isinstance(value, Mapping):
        return {str(key): describe(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [describe(part) for part in value]
    if inspect.isroutine(value) or isinstance(value, type):
        return _call(value, {}, ())
    if not hasattr(value, "__dict__"):
        raise UserError(f"a {full_name(type(value))} cannot be written to recipe.json; hold numbers, tensors or tuples")
    return {"type": full_name(type(value)), **describe(vars(value))}


def _shown(rule: bool | str, value: Any) -> bool:
    """Whether a field is described: always, never, or "if given"; recipes without it are described as before it was."""
    return value not in (None, ()) if rule == "if given" else bool(rule)


def _call(function: Any, keywords: Mapping[str, Any], positional: tuple[Any, ...]) -> dict[str, Any]:
    return {"call": full_name(function), "arguments": describe(keywords), "positional": describe(positional)}


def full_name(value: Any) -> str:
    """Return `module:qualified.name` of a function or class, of the script that runs as `find_object` names it."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    if not (module and name):
        module, name = type(value).__module__, type(value).__qualname__
    return f"{module_name(module)}:{name}"


def matches(before: Any, now: Any) -> bool:
    """Whether two descriptions are of one thing, but for rounding: what is computed differs between processors."""
    if isinstance(before, dict) and isinstance(now, dict):
        if "sha256" in before and "sha256" in now:
            sketched = "sketch" in before and "sketch" in now  # older runs have none, and bytes need none
            if sketched and not _is_near(before["sketch"], now["sketch"]):
                return False
            before, now = (_without(digests, "sketch", *["sha256"] * sketched) for digests in (before, now))
        return before.keys() == now.keys() and all(matches(before[key], now[key]) for key in before)
    if isinstance(before, list) and isinstance(now, list):
        return len(before) == len(now) and all(map(matches, before, now))
    if isinstance(before, float) and isinstance(now, float):
        return math.isclose(before, now, rel_tol=ROUNDING)
    return before == now


def _without(described: dict[str, Any], *names: str) -> dict[str, Any]:
    return {key: value for key, value in described.items() if key not in names}


def _is_near(before: Any, now: list[float]) -> bool:
    """Whether sketches differ by less than rounding; the norms come first. That of recipe.json may be damaged."""
    if not isinstance(before, list) or not all(isinstance(number, int | float) for number in before):
        return False
    return len(before) == len(now) and all(abs(a - b) <= ROUNDING * before[0] for a, b in zip(before, now, strict=True))


def _digests(items: Tensor | Lazy) -> dict[str, Any]:
    exact = {"sha256": fingerprint(items)}
    return {**exact, "sketch": sketch(items)} if items.dtype.is_floating_point else exact


def sketch(items: Tensor | Lazy) -> list[float]:
    """Return the norm of values (N, P), and sums Σ r_n c_p x_np, r and c of random signs that are always the same."""
    rng = torch.Generator().manual_seed(0)
    columns, sums, squares = None, torch.zeros(SKETCHED, dtype=torch.float64), 0.0
    for part in filter(torch.numel, _parts(items)):
        for some in part.detach().cpu().reshape(len(part) if part.dim() > 1 else 1, -1).split(SOME):
            x = some.double()
            columns = _signs(x.shape[1], rng) if columns is None else columns
            sums += (_signs(len(x), rng) * (x @ columns)).sum(0)
            squares += x.square().sum().item()
    return [math.sqrt(squares), *sums.tolist()]


def _signs(n: int, rng: torch.Generator) -> Tensor:
    """(n, SKETCHED)"""
    return (torch.randint(2, (n, SKETCHED), generator=rng) * 2 - 1).double()


def fingerprint(items: Tensor | Lazy) -> str:
    """Return the SHA-256 of a tensor's values, shortened to 16 digits; of many in a file, of `SOME` of them."""
    digest = hashlib.sha256()
    for part in _parts(items):
        digest.update(part.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()[:16]


def _parts(items: Tensor | Lazy) -> Iterable[Tensor]:
    if isinstance(items, Tensor):
        return [items]
    return items.parts() if items.nbytes <= MAX_BYTES_READ else [items[spread_rows(len(items), SOME)]]
