"""Figures from start to end, with arms of a few steps."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject import reproduce as package
from unproject._types import UserError
from unproject.cli import main
from unproject.data.procedural.materials.correlated import build_correlated
from unproject.recipes.shapes import shapes
from unproject.reproduce import FIGURES, Arm, Claim, Figure, Settings, running
from unproject.reproduce.material_sources import PROBES, photographed
from unproject.reproduce.place import Place, Source
from unproject.reproduce.result import Result
from unproject.reproduce.running import is_finished
from unproject.reproduce.scoring import grouped, octave_scores, score, score_truth
from unproject.reproduce.sources import SOURCES, birds, procedural_shapes
from unproject.training import train

SMALL = {"size": 16, "steps": 2, "channels": 8, "batch": 4}
TOY = Figure(
    name="toy",
    title="Digits",
    claim="Digits are learned.",
    paper_says="Nothing.",
    arms=(
        Arm("toy-known", "digits", "digits", "known"),
        Arm("toy-single", "digits", "digits", "one discriminator", {"views": "single"}),
    ),
    claims=(Claim("known is nearer", "toy-known", "toy-single", ("frechet",)),),
)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(package.FIGURES, "toy", TOY)
    monkeypatch.setattr(running, "flags_of", lambda arm, budget: SMALL | dict(arm.flags))
    monkeypatch.setattr("unproject.domains.Images.scored", 64)


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings are in this process, one at a time: what others cost is most of the time that such small ones take."""
    train_here(monkeypatch)


def train_here(monkeypatch: pytest.MonkeyPatch) -> None:
    lock = threading.Lock()

    def wait(self: object, words: list[str]) -> tuple[int, str]:
        with lock:
            return main(words), ""

    monkeypatch.setattr("unproject.reproduce.running._Training._wait", wait)


def test_a_figure_is_trained_kept_and_reported(
    toy: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forked: None
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "toy", "--parallel", "2", "--threads", "1", "--seeds", "1"]) == 0
    kept = tmp_path / "reproduction" / "cpu" / "results"
    first = {path: path.stat().st_mtime_ns for path in kept.iterdir()}
    with monkeypatch.context() as patch:  # the other seeds, without processes
        train_here(patch)
        assert main(["reproduce", "toy", "--threads", "1"]) == 0
    assert {path: path.stat().st_mtime_ns for path in first} == first
    names = {f"toy-{arm}-{seed}" for arm in ("known", "single") for seed in (0, 1)} | {"truth-digits-0"}
    assert {path.stem for path in kept.glob("*.json")} == names
    assert {path.name for path in kept.glob("*-views.webp")} == set()  # line integrals are no pictures
    assert {path.suffix for path in (tmp_path / "reproduction" / "cpu").glob("toy.*")} == {".md", ".html", ".webp"}
    contents = [json.loads((kept / f"toy-known-{seed}.json").read_text()) for seed in (0, 1)]
    for seed, content in enumerate(contents):
        assert content["seed"] == seed and content["steps"] == 2 and content["budget"] == "cpu"
    content = contents[0]
    assert content["environment"]["command"][1:3] == ["train", "digits"] and str(tmp_path) not in json.dumps(content)

    before = {path: path.stat().st_mtime_ns for path in kept.iterdir()}
    os.remove(tmp_path / "reproduction" / "cpu" / "toy.md")
    assert main(["reproduce", "toy", "--report"]) == 0
    assert {path: path.stat().st_mtime_ns for path in kept.iterdir()} == before
    assert (tmp_path / "reproduction" / "cpu" / "toy.md").exists()

    shutil.rmtree(kept)
    assert main(["reproduce", "toy", "--report", "--seeds", "1"]) == 0
    again = json.loads((kept / "toy-known-0.json").read_text())
    assert again["scores"] and not (kept / "toy-known-1.json").exists()


def test_without_training_a_run_that_is_not_finished_is_left_alone(
    toy: None, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu", threads=1)
    arm = TOY.arms[0]
    assert not is_finished(arm, 0, settings)
    monkeypatch.setattr(running, "flags_of", lambda arm, budget: SMALL | {"steps": 1})
    package.running.train_missing([(arm, 0)], settings)
    shutil.rmtree(settings.results_folder)
    monkeypatch.setattr(running, "flags_of", lambda arm, budget: SMALL | {"steps": 2})
    assert not is_finished(arm, 0, settings)
    running.score_finished([(arm, 0)], settings)
    assert not settings.result(arm, 0).exists
    running.train_missing([(arm, 0)], settings)  # resumed
    assert settings.result(arm, 0).read()["steps"] == 2


def test_a_training_that_fails_is_one_line(toy: None, tmp_path: Path, forked: None) -> None:
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu")
    with pytest.raises(UserError, match="bad-0: training stopped: .*views"):
        running.train_missing([(Arm("bad", "digits", "digits", "", {"views": "nonsense"}), 0)], settings)


def test_what_fails_does_not_stop_the_rest(
    toy: None, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bad = Arm("toy-bad", "digits", "digits", "", {"views": "nonsense"})
    monkeypatch.setitem(package.FIGURES, "toy", replace(TOY, arms=(bad, *TOY.arms)))
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu")
    with pytest.raises(UserError, match="toy-bad-0: training stopped"):
        package.reproduce("toy", settings, 1, tmp_path / "out")
    assert settings.result(TOY.arms[0], 0).exists and settings.result(TOY.arms[1], 0).exists
    assert (tmp_path / "out" / "toy.md").exists()


def test_an_interrupted_training_is_no_result(
    toy: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forked: None
) -> None:
    """Training that is asked to stop saves and leaves without an error."""
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu")
    monkeypatch.setattr(running, "flags_of", lambda arm, budget: SMALL | {"steps": 1})
    words = running.command(TOY.arms[0], 0, settings)
    monkeypatch.setattr(running, "flags_of", lambda arm, budget: SMALL)
    monkeypatch.setattr(running, "command", lambda arm, seed, where: words)
    with pytest.raises(UserError, match="interrupted; the same command goes on"):
        running.train_missing([(TOY.arms[0], 0)], settings)
    assert not settings.result(TOY.arms[0], 0).exists


def test_results_and_runs_of_other_flags_are_not_taken(toy: None, here: None, tmp_path: Path) -> None:
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu", threads=1)
    running.train_missing([(TOY.arms[0], 0)], settings)
    other = replace(TOY.arms[0], flags={"bins": 5})
    with pytest.raises(UserError, match="toy-known-0.json: was made with flags .*remove that file"):
        running.train_missing([(other, 0)], settings)
    shutil.rmtree(settings.results_folder)
    for go in (running.train_missing, running.score_finished):
        with pytest.raises(UserError, match="toy-known-0: was made with bins 10, the arm has 5"):
            go([(other, 0)], settings)


def test_more_seeds_than_asked_for_are_reported(toy: None, here: None, tmp_path: Path) -> None:
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu", threads=1)
    running.train_missing([(TOY.arms[0], seed) for seed in (0, 3)], settings)
    assert package.report_of(TOY, settings).seeds("toy-known") == [0, 3]


def test_nothing_to_report_is_one_line(toy: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path / "out"), "--runs", str(tmp_path / "runs"), "--report"]
    assert main(["reproduce", "toy", *words]) == 2
    assert "holds no results" in capsys.readouterr().err and not (tmp_path / "out").exists()


ENDLESS = """
import sys
from pathlib import Path
from unproject.reproduce import Arm, Settings, running

running.flags_of = lambda arm, budget: dict(size=16, steps=10**6, channels=8, batch=4)
settings = Settings(Path(sys.argv[1]), Path(sys.argv[1]) / "kept", None, "cpu", threads=1)
running.train_missing([(Arm("long", "digits", "digits", ""), 0)], settings)
"""


def test_a_reproduction_that_is_ended_ends_its_trainings(tmp_path: Path, forked: None) -> None:
    log = tmp_path / "long-0" / "stats.jsonl"
    deadline = time.monotonic() + 120
    with subprocess.Popen([sys.executable, "-c", ENDLESS, str(tmp_path)], stdout=subprocess.PIPE) as parent:
        while not (log.exists() and log.read_text()) and time.monotonic() < deadline:
            time.sleep(0.1)
        parent.send_signal(signal.SIGTERM)
        parent.communicate(timeout=120)
    assert parent.returncode == 143 and not (tmp_path / "kept").exists()
    assert list((tmp_path / "long-0" / "checkpoints").glob("*.safetensors"))  # it saved and left
    size = log.stat().st_size
    time.sleep(1)
    assert log.stat().st_size == size > 0


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["fig13"], "there is no figure 'fig13'"),
        (["fig7", "--seeds", "0"], "--seeds 0"),
        (["fig7", "--threads", "0"], "--threads 0"),
        (["fig7", "--data", "nowhere"], "--data nowhere: is no folder"),
        (["fig7", "--budget", "huge"], "--budget"),
    ],
)
def test_mistakes_are_one_line(words: list[str], line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", *words]) == 2
    err = capsys.readouterr().err
    assert err.startswith("unproject: ") and line in err and err.count("\n") == 1


def test_octave_scores_know_the_design() -> None:
    from unproject.data.procedural.materials.correlated import CHANCES
    from unproject.data.procedural.materials.noise import draw

    drawn = draw(CHANCES, range(12), 32, 0)
    right = {name: score.value for name, score in octave_scores(build_correlated(drawn, 0.9, 0.9)).items()}
    assert right["octave_error_within"] < 0.05 and right["octave_error_across"] < 0.05
    wrong = octave_scores(build_correlated(drawn, 0.5, 0.9))
    assert wrong["octave_error_within"].value == pytest.approx(0.4, abs=0.05)


def test_images_are_grouped_by_view() -> None:
    images, views = torch.arange(30.0).view(30, 1, 1, 1), torch.tensor([0] * 20 + [2] * 10)
    rows = grouped(images, views, 3).view(3, -1)
    assert rows.shape == (3, 12) and rows[0].tolist() == list(range(12)) and rows[1].eq(0).all()
    assert rows[2, :10].tolist() == list(range(20, 30)) and rows[2, 10:].eq(0).all()


@pytest.mark.parametrize("real", [True, False])
def test_training_images_of_real_collections_are_not_stored(
    real: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    volumes = birds(8, 16)
    np.savez(tmp_path / "masks.npz", sil=(volumes.amax(3) > 0.5).transpose(1, 2).numpy())
    small = {"size": 16, "bins": 4, "channels": 8, "rank": 2, "rounds": 1, "batch": 4, "steps": 1}
    train(shapes(data=tmp_path / "masks.npz", views="predicted", **small), tmp_path / "run", quiet=True)
    monkeypatch.setitem(SOURCES, "masks", Source(dict, lambda place: volumes, real=real))  # type: ignore[arg-type]
    monkeypatch.setattr("unproject.reproduce.scoring.SHAPES", 8)
    result = Result(tmp_path / "kept", "masks", 0)
    score(tmp_path / "run", "masks", Place(tmp_path, tmp_path, 16), result, {})
    kept = {path.name for path in result.folder.glob("*.webp")}
    assert kept == {"masks-0.webp"} | (set() if real else {"masks-0-views.webp"})


def test_the_project_keeps_no_picture_of_a_real_collection() -> None:
    results = Path(__file__).parents[2] / "docs" / "results"
    real = [arm for figure in FIGURES.values() for arm in (*figure.arms, *figure.real) if SOURCES[arm.source].real]
    names = {f"{arm.name}-*-views.webp" for arm in real} | {f"truth-{arm.source}-*.webp" for arm in real}
    assert real and not [path for name in names for path in results.rglob(name)]
    assert not [path for path in results.rglob("*views.webp") if "reproduction" not in path.parts]


def test_files_are_made_once_and_never_half(tmp_path: Path) -> None:
    place = Place(tmp_path, None, 16)
    calls = []

    def fail(path: Path) -> None:
        path.write_text("half")
        calls.append(path)
        raise OSError("full")

    with pytest.raises(OSError):
        place.once("a.txt", fail)
    assert not any(tmp_path.iterdir())
    path = place.once("a.txt", lambda p: None if p.write_text("whole") else None)
    assert place.once("a.txt", fail) == path and path.read_text() == "whole" and len(calls) == 1


def test_what_is_made_of_other_data_is_another_file(tmp_path: Path) -> None:
    folders = (None, tmp_path / "x", tmp_path / "y")
    made = {data: Place(tmp_path, data, 16).once("a.npz", lambda p: p.touch()) for data in folders}
    assert len({*made.values()}) == 3 and all(path.suffix == ".npz" and path.exists() for path in made.values())


@pytest.mark.parametrize("content", ["text", "other arrays"])
def test_a_damaged_collection_is_one_line(tmp_path: Path, content: str) -> None:
    file = tmp_path / "shapes3d" / "cars_kenney_cc0_meshes.npz"
    file.parent.mkdir()
    file.write_text("no archive")
    if content == "other arrays":
        np.savez(file, verts=np.zeros(3))
    with pytest.raises(UserError, match="cars_kenney_cc0_meshes.npz: "):
        SOURCES["cars-meshes"].flags(Place(tmp_path, tmp_path, 16))


def test_a_run_that_cannot_be_scored_stops_no_other(toy: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scored = []

    def score(arm: Arm, seed: int, settings: Settings) -> None:
        if arm.name == "toy-known":
            raise UserError("damaged")
        scored.append(arm.name)

    monkeypatch.setattr(running, "is_finished", lambda *_: True)
    monkeypatch.setattr(running, "check_run", lambda *_: None)
    monkeypatch.setattr(running, "score_run", score)
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu", threads=1)
    with pytest.raises(UserError, match="^damaged$"):
        running.score_finished([(arm, 0) for arm in TOY.arms], settings)
    assert scored == ["toy-single"]


def test_a_family_is_written_as_the_recipe_reads_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.reproduce.sources.SHAPES", 3)
    source = procedural_shapes(birds, "birds")
    place = Place(tmp_path, None, 16)
    with np.load(source.flags(place)["data"]) as arrays:
        assert np.array_equal(arrays["volume"], birds(3, 16).numpy().astype(np.uint8))
    assert not torch.equal(source.reference(place)[:3], birds(3, 16))


def test_photographs_are_lit_as_training_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.reproduce.material_sources.PHOTOGRAPHED", {"metal": (2, 3)})
    flags = photographed("metal").flags(Place(tmp_path, None, 16))
    counts = {folder.name: len(list(folder.iterdir())) for folder in flags["data"].iterdir()}
    assert counts == dict.fromkeys(("diffuse", "specular", "roughness", "normal"), 2) | {"top": 3, "grazing": 3}
    assert len(list(flags["probes"].glob("*.npy"))) == PROBES / 2  # every other


def test_real_sets_are_cut_photographed_and_scored_but_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("unproject.reproduce.material_sources.PHOTOGRAPHED", {"plastic-sets": (2, 3)})
    monkeypatch.setattr("unproject.reproduce.material_sources.MATERIALS", 8)
    materials, probes = tmp_path / "data" / "materials", tmp_path / "data" / "hdr"
    rng = np.random.default_rng(0)
    textures = materials / "svbrdf" / "plastic" / "toy"
    textures.mkdir(parents=True)
    for name, channels in (("albedo", 3), ("roughness", 1)):
        pixels = rng.integers(40, 200, (64, 64, channels), dtype=np.uint8)
        Image.fromarray(pixels.squeeze()).save(textures / f"{name}.png")
    Image.fromarray(np.full((64, 64, 3), (128, 128, 255), np.uint8)).save(textures / "normal.png")
    np.savez(materials / "ambientcg_diffuse64_plastic.npz", albedo64=np.zeros((5, 64, 64, 3), np.uint8))
    probes.mkdir()
    for k in range(2):
        np.save(probes / f"{k}.npy", rng.uniform(0.5, 1, (8, 16, 3)).astype(np.float32))
    place = Place(tmp_path / "runs", tmp_path / "data", 16)
    pictures = SOURCES["plastic-sets"].flags(place)["data"]
    counts = {folder.name: len(list(folder.iterdir())) for folder in pictures.iterdir()}
    assert counts == dict.fromkeys(("specular", "roughness", "normal"), 2) | {"diffuse": 7, "top": 3, "grazing": 3}
    truths = Settings(tmp_path, tmp_path / "kept", place.data, "cpu").truths("plastic-sets")
    score_truth("plastic-sets", place, truths, {"budget": "cpu"})
    assert truths["truth"].exists and not list((tmp_path / "kept").glob("*.webp"))


def test_true_things_are_scored_once_and_shuffled_maps_do_not_go_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("unproject.reproduce.material_sources.MATERIALS", 48)
    settings = Settings(tmp_path, tmp_path / "kept", None, "cpu")
    score_truth("wood", Place(tmp_path, None, 16), settings.truths("wood"), {"budget": "cpu"})
    errors = {name: kept.values()["correlation_error"] for name, kept in settings.truths("wood").items()}
    assert errors["truth"] < errors["shuffled"] / 2
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "kept").iterdir()}
    assert len(before) == 4
    score_truth("wood", Place(tmp_path, None, 16), settings.truths("wood"), {})
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "kept").iterdir()} == before


def test_real_collections_are_asked_for_by_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="give --data"):
        Place(tmp_path, None, 16).real("mnist")
    with pytest.raises(UserError, match="is missing; --data"):
        Place(tmp_path, tmp_path, 16).real("mnist")


def test_what_is_scored_against_is_missed_before_the_training(tmp_path: Path) -> None:
    (tmp_path / "mnist").mkdir()
    (tmp_path / "mnist" / "train-images-idx3-ubyte.gz").touch()
    with pytest.raises(UserError, match="t10k.* is missing"):
        SOURCES["mnist"].flags(Place(tmp_path, tmp_path, 32))


def test_true_things_that_are_missing_do_not_keep_reports_from_being_written(
    toy: None, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(tmp_path / "runs", tmp_path / "kept", None, "cpu")

    def missing(*about: object) -> None:
        raise UserError("probes: is missing")

    monkeypatch.setattr(package, "score_truth", missing)
    with pytest.raises(UserError, match="^probes: is missing$"):
        package.reproduce("toy", settings, 1, tmp_path / "out")
    assert (tmp_path / "out" / "toy.md").exists()
