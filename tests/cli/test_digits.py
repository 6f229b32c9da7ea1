"""A run that makes images, through every verb: trained, resumed, sampled, shown; refused where only shapes will do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unproject.cli import main

TINY = ["--size", "16", "--channels", "16", "--batch", "8", "--steps", "3", "--quiet", "--threads", "1"]


@pytest.fixture(scope="module", params=["known", "predicted", "single", "direct"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp(request.param) / "run"
    assert main(["train", "digits", "--views", request.param, "--rounds", "1", *TINY, "--out", str(out)]) == 0
    return out


def test_a_run_shows_and_gives_its_images(run: Path, tmp_path: Path) -> None:
    assert main(["resume", str(run), "--steps", "4", "--quiet", "--threads", "1"]) == 0
    assert main(["sample", str(run), "--n", "5", "--out", str(tmp_path / "five.npz")]) == 0
    images = np.load(tmp_path / "five.npz")["image"]
    assert images.shape == (5, 1, 16, 16) and images.min() >= 0 and images.max() <= 1
    for source in (run, tmp_path / "five.npz"):
        assert main(["export", str(source), "--to", "png", "--n", "4", "--out", str(tmp_path / "sheet.png")]) == 0
        with Image.open(tmp_path / "sheet.png") as sheet:
            assert sheet.width > 2 * 16
    assert list((run / "samples").glob("*.png"))


@pytest.mark.parametrize("command", [["export", "--to", "glb", "--out", "meshes"], ["evaluate"]])
def test_what_only_shapes_can_do(
    run: Path, command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([command[0], str(run), *command[1:]]) == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: ") and error.count("\n") == 1 and "images" in error
    assert not list(tmp_path.iterdir())
