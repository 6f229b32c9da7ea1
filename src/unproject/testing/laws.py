"""Law: a statement with a test; and the comparisons that tests use."""

from __future__ import annotations

import inspect
import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor

Case = TypeVar("Case")


class LawError(AssertionError):
    """Raised for a part that breaks laws; the message has each law, what was measured and the likely cause."""


class LawResult(NamedTuple):
    """The result of one law for one part."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True)
class Law(Generic[Case]):
    """A law.

    Attributes:
        name: of the law.
        statement: what must hold.
        cause: the likely cause if it does not.
        test: returns what it measured; raises `LawError` if the law is broken.
        first: if this law is broken, later ones cannot be tested and are skipped.
    """

    name: str
    statement: str
    cause: str
    test: Callable[[Case], str]
    first: bool = False

    def apply(self, case: Case) -> LawResult:
        try:
            return LawResult(self.name, True, f"{self.statement} ({self.test(case)})")
        except LawError as error:
            return LawResult(self.name, False, f"{self.statement}; but {error}. Likely cause: {self.cause}")
        except Exception as error:  # any, as the part is a user's
            given = getattr(case, "given", "")
            return LawResult(self.name, False, f"{self.statement}; but {type(error).__name__}: {error}{given}")


def apply_laws(laws: Sequence[Law[Case]], case: Case) -> list[LawResult]:
    results = []
    for law in laws:
        results.append(law.apply(case))
        if law.first and not results[-1].passed:
            break
    return results


def raise_broken(part: Any, results: list[LawResult]) -> None:
    broken = [f"- {r.name}: {r.detail}" for r in results if not r.passed]
    if broken:
        raise LawError("\n".join([f"{type(part).__name__} breaks {len(broken)} of {len(results)} laws tried", *broken]))


def need(holds: bool, otherwise: str) -> None:
    if not holds:
        raise LawError(otherwise)


def same(a: Tensor, b: Tensor, tolerance: float, what: str) -> str:
    """Require a = b within `tolerance` relative to the largest value; NaN equals NaN, as finiteness is another law."""
    need(a.shape == b.shape, f"{what} have the shapes {tuple(a.shape)} and {tuple(b.shape)}")
    both = a.isfinite() & b.isfinite()
    error = (a[both] - b[both]).abs().max().item() if both.any() else 0.0
    bound = tolerance * max(1.0, b[both].abs().max().item() if both.any() else 0.0)
    need(error <= bound and bool((a.isfinite() == b.isfinite()).all()), f"{what} differ by {error:.3g}")
    return f"largest difference {error:.1g}"


def equal(a: Any, b: Any) -> bool:
    if isinstance(a, Tensor) and isinstance(b, Tensor):
        return a.shape == b.shape and bool(((a == b) | ((a != a) & (b != b))).all())
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(equal(a[k], b[k]) for k in a)
    if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        return len(a) == len(b) and all(map(equal, a, b))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(np.asarray(a), np.asarray(b))
    # Without __eq__ an object never equals its deep copy: compare the attributes.
    return equal(vars(a), vars(b)) if _plain_object(a) and type(a) is type(b) else bool(a == b)


def _plain_object(value: Any) -> bool:
    code = inspect.isroutine(value) or isinstance(value, type)
    return type(value).__eq__ is object.__eq__ and hasattr(value, "__dict__") and not code


@contextmanager
def global_seed(seed: int) -> Iterator[None]:
    """Seed the global generators of torch, numpy and Python, and restore them afterwards."""
    python, numpy = random.getstate(), np.random.get_state()
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            random.seed(seed)
            np.random.seed(seed)
            yield
    finally:
        random.setstate(python)
        np.random.set_state(numpy)
