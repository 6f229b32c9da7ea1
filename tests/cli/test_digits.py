"""A run that makes images, through every verb: trained, resumed, sampled, shown, scored; no meshes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unproject.cli import main

TINY = ["--size", "16", "--channels", "16", "--batch", "8", "--steps", "3", "--quiet", "--threads", "1"]


@pytest.fixture(scope="module", params=["known", "predicted", "learned", "single", "direct"])
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


def test_a_run_is_scored(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Against the digits that are kept for it, against a file of images, and against measured lines."""
    arguments = ["evaluate", str(run), "--n", "20", "--json", "--threads", "1"]
    assert main(arguments) == 0
    scores = json.loads(capsys.readouterr().out)
    free = run.parent.name[:-1] in ("predicted", "learned", "single")
    assert {"frechet", "kernel_image", "precision", "recall", "density", "coverage", "class_3"} <= set(scores)
    assert ("gauge_turn" in scores) == free and ("view_exact" in scores) == (run.parent.name[:-1] == "predicted")
    assert scores["frechet"]["n"] == 20 and "20 generated vs 297 reference" in scores["frechet"]["protocol"]
    if free:
        assert "best of 40 dihedral gauges" in scores["frechet"]["protocol"]
    np.savez(tmp_path / "own.npz", images=np.random.default_rng(0).random((9, 12, 12), np.float32))
    with pytest.warns(UserWarning, match="the references do not look like handwritten digits"):
        assert main([*arguments, "--reference", str(tmp_path / "own.npz")]) == 0
    assert "20 generated vs 9 reference" in json.loads(capsys.readouterr().out)["frechet"]["protocol"]
    np.savez(tmp_path / "lines.npz", lines=np.random.default_rng(0).random((9, 16), np.float32))
    status = main([*arguments, "--reference", str(tmp_path / "lines.npz")])
    if run.parent.name[:-1] == "direct":  # which sees no lines
        error = capsys.readouterr().err
        assert status == 2 and error.startswith("unproject: the references are of shape") and error.count("\n") == 1
    else:
        assert status == 0 and "kernel_line" in json.loads(capsys.readouterr().out)


def test_there_is_no_mesh_of_an_image(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(run), "--to", "glb", "--out", "meshes"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: ") and error.count("\n") == 1 and "choose from npz, png" in error
    assert not list(tmp_path.iterdir())
