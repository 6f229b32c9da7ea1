"""Precision: bfloat16 where the processor multiplies in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import torch

from .defaults import Function, with_default


def fast_precision() -> Literal["float32", "bfloat16"]:
    """Return bfloat16 if this processor is likely to be faster in it, and no GPU takes its place, else float32.

    The processor decides rather than a measurement, which other programs disturb: the same command makes the same run.
    By AVX-512 bfloat16 was faster on an AMD EPYC and no faster on an Intel Xeon, whose fast instructions for it are AMX
    (docs/results.md, "The cost of a step"); on an H100 it was slower (docs/scale.md).
    """
    if torch.cuda.is_available():
        return "float32"
    capabilities = getattr(torch.cpu, "get_capabilities", dict)()  # older PyTorch does not tell
    of_intel = "intel" in str(capabilities.get("cpu_name")).lower()
    fast = capabilities.get("amx_bf16") or (capabilities.get("avx512_bf16") and not of_intel)
    return "bfloat16" if fast else "float32"


def in_fast_precision(
    function: Function, where: Callable[[Mapping[str, Any]], bool] = lambda arguments: True
) -> Function:
    """Give a recipe function the precision that is fast here, unless one is given, or not `where` its arguments say."""
    return with_default("precision", lambda arguments: fast_precision() if where(arguments) else None)(function)
