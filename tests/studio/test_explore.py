"""Explore: what is drawn at a place of the latents is what the run would sample there."""

from __future__ import annotations

import base64
import io
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor, nn

from unproject.assignment import Panel
from unproject.cli import main
from unproject.data import Collection, metal
from unproject.domains import Images, Maps
from unproject.networks import Discriminator, Generator, ImageGenerator, SmoothImageGenerator
from unproject.projections.base import Identity
from unproject.projections.observation import Observation
from unproject.studio.answers import Request
from unproject.studio.explore import file_name, thumbnail
from unproject.studio.space import DIRECTIONS, PICKS, Space, slerp
from unproject.studio.state import State
from unproject.training import Recipe, Run, checkpoint, load, train

TOY = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}:toy"

Said = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="module")
def space() -> Space:
    torch.manual_seed(0)
    generator = ImageGenerator(size=16, code_size=8, channels=16).eval()
    return Space.of(Run(Path("run"), generator, 1, Images()))


def test_a_pick_is_the_sample_of_that_number(space: Space) -> None:
    x = space.run.sample(4)
    found = space.samples(space.place(Request({"pick": "3"})))
    assert (found[0] - x[3]).abs().max() < 0.02


def test_truncation_ends_at_the_mean_for_every_pick(space: Space) -> None:
    places = [space.place(Request({"pick": str(k), "truncation": "0"})) for k in (0, 5)]
    assert places[0].equal(places[1]) and not places[0].any()


def test_the_ends_of_the_way_are_the_picks(space: Space) -> None:
    for mix, pick in ((0, 2), (1, 7)):
        found = space.place(Request({"pick": "2", "other": "7", "mix": str(mix)}))[0]
        assert torch.allclose(found, space.picks[pick], atol=1e-5)


def test_what_lies_between_is_as_usual_as_the_picks() -> None:
    a, b = torch.randn(2, 256, generator=torch.manual_seed(0))
    assert abs(slerp(a, b, 0.5).norm() - (a.norm() + b.norm()) / 2) < 1e-3


def test_a_slider_moves_along_its_direction_only(space: Space) -> None:
    before, after = (space.place(Request({"slides": slides}))[0] for slides in ("0", "0,2"))
    assert torch.allclose(after - before, 2 * space.directions[1], atol=1e-5)
    assert torch.allclose(space.directions @ space.directions.T, torch.eye(len(space.directions)), atol=1e-4)


def test_there_are_as_many_sliders_as_axes(tmp_path: Path, said: Said) -> None:
    panel = Panel([Observation("itself", Identity())], Collection(torch.rand(8, 1, 16, 16)))
    generator = partial(SmoothImageGenerator, size=16, code_size=3, channels=8)
    recipe = Recipe(generator, [panel], discriminator=partial(Discriminator, channels=4), steps=1, batch=4)
    train(recipe, tmp_path / "few", quiet=True)
    assert said(State(tmp_path), "/api/grid", run="few")[1]["sliders"] == 3
    moved = ("1,0,2", "1,0,2,1,1,1,1,1")
    few, many = (said(State(tmp_path), "/api/sample", run="few", slides=slides) for slides in moved)
    assert few == many and few[0] == 200


class Stretched(Generator):
    """Images of which entry 5 of the code changes a lot, and entry 2 a little."""

    domain = "images"

    def __init__(self) -> None:
        super().__init__(8)
        self.scale = nn.Parameter(torch.tensor([0, 0, 1.0, 0, 0, 9.0, 0, 0]))

    def forward(self, code: Tensor) -> Tensor:
        return (code * self.scale).view(-1, 1, 2, 4)


def test_the_first_direction_is_that_in_which_samples_differ_most() -> None:
    found = Space.of(Run(Path("run"), Stretched().eval(), 1, Images()))
    w = found.directions[:2] @ found.latents.axes
    assert w[0].abs().argmax() == 5 and w[0].abs()[5] / w[0].norm() > 0.95
    assert w[1].abs().argmax() == 2


WRONG = {
    "pick": {"pick": PICKS},
    "half a pick": {"pick": 0.5},
    "other": {"other": -1},
    "mix": {"mix": 2},
    "truncation": {"truncation": "nan"},
    "too many slides": {"slides": ",".join(["0"] * (DIRECTIONS + 1))},
    "a far slide": {"slides": "1e9"},
    "no number": {"slides": "a,b"},
}


@pytest.mark.parametrize("query", WRONG.values(), ids=list(WRONG))
def test_a_place_that_is_none_is_refused(runs: Path, said: Said, query: dict[str, object]) -> None:
    status, answer = said(State(runs), "/api/sample", run="toy", **query)
    assert status == 400 and answer["error"]


def test_the_grid_shows_samples_of_the_run(runs: Path, said: Said) -> None:
    status, found = said(State(runs), "/api/grid", run="toy", page=1)
    assert (status, found["kind"], found["sliders"]) == (200, "volume", DIRECTIONS)
    assert [sample["pick"] for sample in found["samples"]] == list(range(24, 48))
    assert base64.b64decode(found["samples"][0]["picture"].partition(",")[2])[8:12] == b"WEBP"


def test_a_sample_is_drawn_or_said_to_be_empty(runs: Path, said: Said) -> None:
    status, found = said(State(runs), "/api/sample", run="toy")
    assert found.get("kind") == "shapes" if status == 200 else "nothing is to be seen" in found["error"]


def test_a_run_without_checkpoint_says_so(runs: Path, tmp_path: Path, said: Said) -> None:
    (tmp_path / "new" / "checkpoints").mkdir(parents=True)
    (tmp_path / "new" / "recipe.json").write_text((runs / "toy" / "recipe.json").read_text())
    status, found = said(State(tmp_path), "/api/sample", run="new")
    assert status == 400 and "no checkpoint" in found["error"]


def test_an_older_step_is_shown_as_long_as_it_is_open(runs: Path, tmp_path: Path, said: Said) -> None:
    """Newer weights change nothing that names a step, in the grid, on the stage or in a file."""
    shutil.copytree(runs / "toy", tmp_path / "toy")
    state = State(tmp_path)
    before = [said(state, path, run="toy") for path in ("/api/grid", "/api/sample")]
    assert before[0][1]["step"] == 2
    folder = tmp_path / "toy" / "checkpoints"
    tensors = checkpoint.load(checkpoint.newest(folder))
    checkpoint.save(
        folder, 9, {name: value * 2 if name.startswith("average/") else value for name, value in tensors.items()}
    )
    assert [said(state, path, run="toy", step=2) for path in ("/api/grid", "/api/sample")] == before
    assert said(state, "/api/grid", run="toy")[1]["step"] == 9
    assert said(state, "/api/newest", run="toy")[1]["step"] == 9
    status, answer = said(State(tmp_path), "/api/grid", run="toy", step=2)
    assert (status, answer["error"]) == (404, "toy: its weights of step 2 are no longer there; show the newest")
    assert said(state, "/api/grid", run="toy", step="x")[0] == 400


def test_weights_that_are_written_while_a_run_is_opened_have_their_own_step(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(runs / "toy", tmp_path / "toy")
    folder = tmp_path / "toy" / "checkpoints"

    def meanwhile(path: Path, **given: Any) -> Run:
        if checkpoint.newest_step(folder) == 2:
            checkpoint.save(folder, 9, checkpoint.load(checkpoint.newest(folder)))
        return load(path, **given)

    monkeypatch.setattr("unproject.studio.state.load", meanwhile)
    state = State(tmp_path)
    assert [state.opened("toy").step, state.opened("toy").step, state.opened("toy", 2).step] == [2, 9, 2]


NAMED = {
    "toy-03": {"pick": 3},
    "toy-03-changed": {"pick": 3, "slides": "0,1"},
    "toy-03-to-11": {"pick": 3, "other": 11, "mix": 0.5},
    "toy-04": {"pick": 4, "other": 11, "mix": 0},
    "toy-03-to-11-changed": {"pick": 3, "other": 11, "mix": 1, "truncation": 0.5},
}


@pytest.mark.parametrize("name, query", NAMED.items(), ids=list(NAMED))
def test_files_are_named_by_the_sample_as_export_counts_them(name: str, query: dict[str, object]) -> None:
    assert file_name("toy", Request({k: str(v) for k, v in query.items()})) == name


def test_metals_are_not_black_in_the_grid() -> None:
    """They have no diffuse albedo; and a specular map means what the domain says."""
    maps = metal(1, 32, 0)
    maps[:, :3] = 0
    seen = []
    for domain in (Maps("albedo"), Maps("eta")):
        content = base64.b64decode(thumbnail(domain, maps).uri.partition(",")[2])
        with Image.open(io.BytesIO(content)) as picture:
            seen.append(float(np.asarray(picture.convert("L")).mean()))
    assert min(seen) > 20 and abs(seen[0] - seen[1]) > 5


def test_a_run_that_was_made_again_is_opened_again(runs: Path, tmp_path: Path) -> None:
    shutil.copytree(runs / "toy", tmp_path / "toy")
    state = State(tmp_path)
    before, version = state.opened("toy"), state.version(state.opened("toy"))
    assert state.opened("toy") is before
    shutil.rmtree(tmp_path / "toy")
    words = ["train", TOY, "--views", "known", "--steps", "2", "--seed", "5", "--quiet", "--out", str(tmp_path / "toy")]
    assert main(words) == 0
    again = state.opened("toy")
    assert not torch.equal(again.sample(2), before.sample(2)) and again.step == before.step
    assert state.version(again) != version
