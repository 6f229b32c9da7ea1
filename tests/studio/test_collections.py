"""Collections in the studio: pictures by assigned view, and corrections that `unproject train` reads."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file

from unproject.assignment import Assignment, Known, LearnedPrior, Panel, Predicted, Unassigned
from unproject.cli import main
from unproject.data import Collection, chairs, observe, with_flips
from unproject.data.readers.views import read_views
from unproject.projections import Silhouette, azimuth_bins
from unproject.projections.priors import Product, Uniform
from unproject.studio.answers import Request
from unproject.studio.collections import _panel, _sorted
from unproject.studio.corrections import corrections_of, middle, store
from unproject.studio.server import respond
from unproject.studio.state import State
from unproject.training import checkpoint
from unproject.training.checkpoint import checkpoint_of, newest

Said = Callable[..., tuple[int, dict[str, Any]]]
TOY = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}:toy"
PICTURES = 48
"""24 chairs in two views each."""


@pytest.fixture
def predicted(tmp_path: Path) -> State:
    """A run whose views were predicted."""
    assert main(["train", TOY, "--steps", "8", "--quiet", "--out", str(tmp_path / "toy")]) == 0
    return State(tmp_path, trust=True)


def test_pictures_are_shown_by_their_views_the_least_sure_first(predicted: State, said: Said) -> None:
    _, found = said(predicted, "/api/collection", run="toy")
    assert (found["pictures"], sum(found["counts"]), len(found["labels"])) == (PICTURES, PICTURES, 4)
    assert found["correctable"] and found["views"] == "predicted"
    view = max(range(4), key=lambda k: found["counts"][k])
    _, part = said(predicted, "/api/pictures", run="toy", view=view)
    assert part["total"] == found["counts"][view]
    assert {one["view"] for one in part["pictures"]} == {view}
    sure = [one["sure"] for one in part["pictures"]]
    assert sure == sorted(sure) and 0 <= sure[0] <= sure[-1] <= 1


def test_an_elevation_below_the_horizon_is_negative_as_training_reads_it() -> None:
    prior = Product(Uniform("azimuth", -0.1, 0.1), Uniform("elevation", -math.radians(20), -math.radians(10)))
    assert middle(prior) == pytest.approx({"azimuth": 0, "elevation": -15})


def corrected(said: Said, state: State, name: str, view: object) -> tuple[int, dict[str, Any]]:
    return said(state, "/api/view", "POST", json.dumps({"run": "toy", "name": name, "view": view}).encode())


def test_a_corrected_view_is_kept_in_a_table_that_training_reads(predicted: State, said: Said, tmp_path: Path) -> None:
    first, second = said(predicted, "/api/pictures", run="toy")[1]["pictures"][:2]
    for one in (first, second):
        wanted = (one["view"] + 1) % 4
        assert corrected(said, predicted, one["name"], wanted)[0] == 200
    again = State(predicted.folder.given, trust=True)
    assert said(again, "/api/collection", run="toy")[1]["corrected"] == 2
    listed = said(again, "/api/pictures", run="toy", view=(first["view"] + 1) % 4)[1]["pictures"]
    assert next(one for one in listed if one["name"] == first["name"])["corrected"]
    _, all_of_them = said(again, "/api/pictures", run="toy")
    names = tuple(one["name"] for one in all_of_them["pictures"])
    (tmp_path / "views.csv").write_bytes(
        respond(again, "GET", "/api/views.csv", Request({"run": "toy"})).content  # as it is downloaded
    )
    azimuth = read_views(tmp_path / "views.csv", names)["azimuth"]
    by_name = dict(zip(names, azimuth.tolist(), strict=True))
    step = 2 * math.pi / 4
    assert by_name[first["name"]] / step % 4 == pytest.approx((first["view"] + 1) % 4, abs=0.01)


WRONG = {"no picture": ("none.png", 0), "no view": (None, 4), "a fraction": (None, 0.5), "true": (None, True)}


@pytest.mark.parametrize("name, view", WRONG.values(), ids=list(WRONG))
def test_a_correction_that_makes_no_sense(predicted: State, said: Said, name: str | None, view: object) -> None:
    one = said(predicted, "/api/pictures", run="toy")[1]["pictures"][0]["name"]
    status, found = corrected(said, predicted, name or one, view)
    assert status == 400 and "give a picture of the run and a view from 0 to 3" in found["error"]
    assert not (predicted.folder.given / "toy" / "corrections.csv").exists()


def test_known_views_have_no_confidence(runs: Path, said: Said) -> None:
    _, part = said(State(runs, trust=True), "/api/pictures", run="toy")
    assert part["total"] and {one["sure"] for one in part["pictures"]} == {None}


def test_code_from_elsewhere_is_not_imported_unasked(runs: Path, said: Said) -> None:
    status, found = said(State(runs), "/api/collection", run="toy")
    assert status == 400 and "trust" in found["error"]


@pytest.mark.filterwarnings("ignore:.*1 of 7 skipped, the first. bad.png")
def test_pictures_that_were_skipped_are_named(tmp_path: Path, said: Said) -> None:
    masks = tmp_path / "masks"
    masks.mkdir()
    for k in range(6):
        picture = np.zeros((40, 40), np.uint8)
        picture[8:32, 10 : 20 + k] = 255
        Image.fromarray(picture).save(masks / f"{k}.png")
    (masks / "bad.png").write_bytes(b"no picture")
    words = ["train", TOY, "--data", str(masks), "--steps", "8", "--quiet", "--out", str(tmp_path / "runs" / "toy")]
    assert main(words) == 0
    _, found = said(State(tmp_path / "runs", trust=True), "/api/collection", run="toy")
    assert found["skipped"] == [["bad.png", "unreadable: no picture of a known format"]]


def views_csv(state: State) -> dict[str, list[str]]:
    """Picture → azimuth and elevation of the views.csv that is downloaded."""
    answer = respond(state, "GET", "/api/views.csv", Request({"run": "toy"}))
    assert answer.status == 200, answer.content
    return {name: angles for name, *angles in csv.reader(io.StringIO(answer.content.decode()))}


def trained_on(state: State) -> State:
    """The run after other views were predicted: every picture has the next one."""
    file = newest(state.folder.given / "toy" / "checkpoints")
    assert file is not None
    tensors = load_file(file)
    tensors["panels/0/assignment/views"] = (tensors["panels/0/assignment/views"] + 1) % 4
    checkpoint.save(file.parent, 9, tensors)
    os.utime(checkpoint_of(file.parent, 9), (time.time() + 9, time.time() + 9))
    return State(state.folder.given, trust=True)


def test_one_correction_stays_one_when_training_goes_on(predicted: State, said: Said) -> None:
    before = views_csv(predicted)
    one = said(predicted, "/api/pictures", run="toy")[1]["pictures"][0]
    wanted = (one["view"] + 2) % 4
    assert corrected(said, predicted, one["name"], wanted) == (200, {"corrected": 1})
    stored = (predicted.folder.given / "toy" / "corrections.csv").read_text()
    assert stored.splitlines()[0].startswith("file,azimuth") and stored.count("\n") == 2
    assert not (predicted.folder.given / "toy" / "views.csv").exists()
    later = trained_on(predicted)
    assert said(later, "/api/collection", run="toy")[1]["corrected"] == 1
    after = views_csv(later)
    assert [name for name in before if before[name] == after[name]] == ["file"]
    assert float(after[one["name"]][0]) == pytest.approx(90 * wanted)


def test_corrections_of_a_version_before_are_read_as_long_as_they_can_be_told(predicted: State, said: Said) -> None:
    """It kept the views of all pictures in the run's views.csv."""
    run, one = predicted.folder.given / "toy", said(predicted, "/api/pictures", run="toy")[1]["pictures"][0]
    views = views_csv(predicted)
    views[one["name"]][0] = str(90 * ((one["view"] + 2) % 4))
    (run / "views.csv").write_text("".join(f"{','.join([name, *angles])}\n" for name, angles in views.items()))
    found = said(predicted, "/api/collection", run="toy")[1]
    assert (found["corrected"], found["outdated"]) == (1, False)
    later = trained_on(predicted)
    found = said(later, "/api/collection", run="toy")[1]
    assert (found["corrected"], found["outdated"]) == (0, True)
    assert corrected(said, later, one["name"], 0)[1] == {"corrected": 1}
    assert said(later, "/api/collection", run="toy")[1]["outdated"] is False


UNKNOWN = {
    "unassigned": (Unassigned(), "none"),
    "a learned distribution": (LearnedPrior(), "none"),
    "not yet predicted": (Predicted(), "none"),
    "known": (Known(), "known"),
}


@pytest.mark.parametrize("assignment, known", UNKNOWN.values(), ids=list(UNKNOWN))
def test_views_that_no_picture_was_given_are_not_shown(assignment: Assignment, known: str) -> None:
    views = azimuth_bins(4, Silhouette(size=16))
    pictures = observe(chairs(6, 16), views)
    held_out = observe(chairs(2, 16), views)
    if known == "none":
        pictures, held_out = (Collection(y.floats(), names=y.names) for y in (pictures, held_out))
    panel = Panel(views, pictures, assignment, held_out=held_out)
    found = _panel(panel.assignment.begin(panel, seed=0), 0, None)
    assert found.known == known and found.sure is None and len(found.names) == len(found.views) == 8
    if known == "none":
        assert found.labels == [] and found.angles() is None and set(found.views.tolist()) == {-1}
    else:
        assert found.angles() is not None
        assert found.views.tolist() == torch.cat([pictures.latents["view"], held_out.latents["view"]]).tolist()  # pyright: ignore


def test_pictures_without_views_have_no_table_and_no_corrections(tmp_path: Path, said: Said) -> None:
    assert main(["train", TOY, "--views", "single", "--steps", "2", "--quiet", "--out", str(tmp_path / "toy")]) == 0
    state = State(tmp_path, trust=True)
    found = said(state, "/api/collection", run="toy")[1]
    assert (found["views"], found["labels"], found["counts"], found["correctable"]) == ("none", [], [], False)
    assert {one["view"] for one in said(state, "/api/pictures", run="toy")[1]["pictures"]} == {-1}
    assert said(state, "/api/views.csv", run="toy")[0] == 400
    name = said(state, "/api/pictures", run="toy")[1]["pictures"][0]["name"]
    assert corrected(said, state, name, 0)[0] == 400


def test_mirror_images_are_not_listed() -> None:
    """They are no files, so that a correction of one would be lost."""
    views = azimuth_bins(4, Silhouette(size=16))
    panel = Panel(views, with_flips(Collection(observe(chairs(6, 16), views).floats())), Predicted())
    state = panel.assignment.begin(panel, seed=0)
    state.view_probabilities = lambda: torch.rand(12, 4, generator=torch.manual_seed(0))
    found = _panel(state, 0, None)
    assert found.names == panel.collections[0].names[::2] and torch.equal(found.views, state.views[::2].long())
    assert found.sure is not None and len(found.sure) == 6
    assert torch.equal(found.picture(3), panel.batch(torch.tensor([6])))


def test_corrections_of_other_panels_are_kept(tmp_path: Path) -> None:
    angles = [{"azimuth": 0.0}, {"azimuth": 90.0}]
    store(tmp_path, {"other.png": 1}, angles, ["other.png"])
    store(tmp_path, {"a.png": 0}, angles, ["a.png", "b.png"])
    store(tmp_path, {"a.png": 1}, angles, ["a.png", "b.png"])
    assert (tmp_path / "corrections.csv").read_text() == "file,azimuth\na.png,90\nother.png,90\n"
    assert corrections_of(tmp_path, angles, {"a.png": 1, "b.png": 0}) == {"a.png": 1}


def test_volumes_are_shown(tmp_path: Path, said: Said) -> None:
    flags = "--views direct --size 16 --channels 16 --rank 8 --batch 8 --steps 2 --tries 1 --quiet"
    assert main(["train", "shapes", *flags.split(), "--out", str(tmp_path / "direct")]) == 0
    status, part = said(State(tmp_path), "/api/pictures", run="direct")
    assert status == 200 and part["pictures"][0]["picture"].startswith("data:image/webp")


def test_a_run_made_anew_is_read_anew(runs: Path, tmp_path: Path, said: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(runs / "toy", tmp_path / "toy")
    state, read = State(tmp_path, trust=True), []
    monkeypatch.setattr("unproject.studio.collections._sorted", lambda *of: read.append(of) or _sorted(*of))
    for _ in range(2):
        assert said(state, "/api/pictures", run="toy")[0] == 200
    assert len(read) == 1
    os.utime(newest(tmp_path / "toy" / "checkpoints"), (1, 1))
    assert said(state, "/api/pictures", run="toy")[0] == 200 and len(read) == 2
