"""The precision that `shapes` trains in: bfloat16 by the processor's instructions, kept by the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from unproject.recipes.precision import fast_precision
from unproject.recipes.shapes import shapes
from unproject.training import rebuild, resume, train
from unproject.training.run_directory import read_recipe

SMALL: dict[str, Any] = {"size": 16, "bins": 2, "views_per_shape": 2, "channels": 8, "rank": 2, "steps": 2, "tries": 1}


@pytest.fixture
def processor(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return what gives the processor its capabilities."""
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 12)

    def has(**capabilities: bool | str) -> None:
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities, raising=False)

    return has


@pytest.mark.parametrize("instructions", ["avx512_bf16", "amx_bf16"])
def test_bfloat16_where_the_processor_has_it(processor: Any, instructions: str) -> None:
    processor(avx2=True, **{instructions: True})
    assert fast_precision() == shapes(**SMALL).precision == "bfloat16"
    assert shapes(**SMALL, precision="float32").precision == "float32"


def test_intel_needs_amx(processor: Any) -> None:
    processor(avx512_bf16=True, amx_bf16=False, cpu_name="Intel Xeon")
    assert fast_precision() == "float32"
    processor(avx512_bf16=True, amx_bf16=True, cpu_name="Intel Xeon")
    assert fast_precision() == "bfloat16"


def test_float32_elsewhere(processor: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    processor(avx2=True, avx512_bf16=False)
    assert fast_precision() == shapes(**SMALL).precision == "float32"
    monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    assert fast_precision() == "float32"


def test_float32_where_there_is_a_gpu(processor: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    processor(avx512_bf16=True)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert fast_precision() == "float32"


def test_a_run_keeps_its_precision_on_another_processor(processor: Any, tmp_path: Path) -> None:
    processor(avx512_bf16=False)
    made = shapes(**SMALL)
    train(made, tmp_path / "run", quiet=True)
    processor(avx512_bf16=True)
    stored = read_recipe(tmp_path / "run")
    assert stored["arguments"]["precision"] == stored["resolved"]["precision"] == "float32"
    assert rebuild(made.origin).precision == "float32"


def test_a_run_of_before_recipes_chose_one_goes_on_in_float32(processor: Any, tmp_path: Path) -> None:
    processor(avx512_bf16=True)
    train(shapes(**SMALL, precision="float32"), tmp_path / "run", quiet=True)
    file = tmp_path / "run" / "recipe.json"
    stored = json.loads(file.read_text())
    del stored["arguments"]["precision"]
    file.write_text(json.dumps(stored))
    resume(tmp_path / "run", steps=3, quiet=True)
    assert json.loads(file.read_text())["resolved"]["precision"] == "float32"


@pytest.mark.parametrize("flag", ["rectilinear", "varied", "inflated"])
def test_a_run_of_before_a_preference_goes_on_without(flag: str, processor: Any, tmp_path: Path) -> None:
    processor(avx512_bf16=False)
    train(shapes(**SMALL, **{flag: 0.0}), tmp_path / "run", quiet=True)
    file = tmp_path / "run" / "recipe.json"
    stored = json.loads(file.read_text())
    del stored["arguments"][flag]
    file.write_text(json.dumps(stored))
    assert resume(tmp_path / "run", steps=3, quiet=True).step == 3
