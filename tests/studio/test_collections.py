"""Collections in the studio: pictures by assigned view, and corrections that `unproject train` reads."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from unproject.cli import main
from unproject.data.readers.views import read_views
from unproject.projections.priors import Product, Uniform
from unproject.studio.collections import Sorted, _middle, _others, _sorted, _table
from unproject.studio.state import State
from unproject.training.checkpoint import newest

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
    assert found["correctable"] and not found["known"]
    view = max(range(4), key=lambda k: found["counts"][k])
    _, part = said(predicted, "/api/pictures", run="toy", view=view)
    assert part["total"] == found["counts"][view]
    assert {one["view"] for one in part["pictures"]} == {view}
    sure = [one["sure"] for one in part["pictures"]]
    assert sure == sorted(sure) and 0 <= sure[0] <= sure[-1] <= 1


def test_an_elevation_below_the_horizon_is_negative_as_training_reads_it() -> None:
    prior = Product(Uniform("azimuth", -0.1, 0.1), Uniform("elevation", -math.radians(20), -math.radians(10)))
    assert _middle(prior) == pytest.approx({"azimuth": 0, "elevation": -15})


def corrected(said: Said, state: State, name: str, view: object) -> tuple[int, dict[str, Any]]:
    return said(state, "/api/view", "POST", json.dumps({"run": "toy", "name": name, "view": view}).encode())


def test_a_corrected_view_is_kept_in_a_table_that_training_reads(predicted: State, said: Said) -> None:
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
    azimuth = read_views(predicted.folder.given / "toy" / "views.csv", names)["azimuth"]
    by_name = dict(zip(names, azimuth.tolist(), strict=True))
    step = 2 * math.pi / 4
    assert by_name[first["name"]] / step % 4 == pytest.approx((first["view"] + 1) % 4, abs=0.01)


WRONG = {"no picture": ("none.png", 0), "no view": (None, 4), "a fraction": (None, 0.5), "true": (None, True)}


@pytest.mark.parametrize("name, view", WRONG.values(), ids=list(WRONG))
def test_a_correction_that_makes_no_sense(predicted: State, said: Said, name: str | None, view: object) -> None:
    one = said(predicted, "/api/pictures", run="toy")[1]["pictures"][0]["name"]
    status, found = corrected(said, predicted, name or one, view)
    assert status == 400 and "give a picture of the run and a view from 0 to 3" in found["error"]
    assert not (predicted.folder.given / "toy" / "views.csv").exists()


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


def test_the_table_has_no_mirror_images_and_keeps_other_panels(tmp_path: Path) -> None:
    chosen = Sorted.__new__(Sorted)
    object.__setattr__(chosen, "names", ("a.png", "a.png flipped", "b.png"))
    angles = [{"azimuth": 0.0}, {"azimuth": 90.0}]
    table = _table(chosen, torch.tensor([1, 0, 0]), angles)
    assert table == "file,azimuth\na.png,90\nb.png,0\n"
    (tmp_path / "views.csv").write_text("file,azimuth\na.png,0\nother.png,45\n")
    assert _others(tmp_path / "views.csv", chosen) == "other.png,45\n"


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
