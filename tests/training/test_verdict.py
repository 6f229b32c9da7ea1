"""The verdict of a run: deterministic, without a trace in the run, and said where it should be."""

from __future__ import annotations

import json
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from toy import BINS, CHAIRS, SIZE, only_panel, toy

from unproject.assignment import Panel, Predicted
from unproject.cli import main
from unproject.data import Collection, chairs
from unproject.domains import Volumes
from unproject.metrics import Finding, Score
from unproject.training import Run, Verdict, resume, train
from unproject.training import verdict as module
from unproject.training.verdict import (
    MOST_NEAR,
    are_near,
    evidence,
    held_out_images,
    held_out_near,
    judge,
    panel_findings,
)

RECIPE = toy(steps=2)
TOY = f"{Path(__file__).parent / 'toy.py'}:toy"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return train(RECIPE, tmp_path_factory.mktemp("run") / "run", quiet=True)


def finding(value: float, says: str) -> Finding:
    return Finding("one", Score(value, "as given", 4), 1, 2, says, f"mend {says}")


def test_the_line_says_what_is_worst_and_what_to_do() -> None:
    good, doubtful, failed = finding(0, "a"), finding(1, "b"), finding(2, "c")
    assert Verdict((good, doubtful, failed)).line == "failed: c; next: mend c"
    assert Verdict((good, doubtful, finding(1, "d"))).line == "doubtful: b; d; next: mend b"
    assert Verdict((good, finding(0, "e"))).line == "good: a, e"
    assert (
        Verdict(()).line.startswith("nothing was judged: that takes 8 pictures of a kind")
        and Verdict(()).scores() == {}
    )


def test_scores_of_a_verdict() -> None:
    scores = Verdict((finding(0, "a"), finding(1, "b"))).scores()
    assert scores["verdict"].value == 1.0 and scores["verdict"].protocol.startswith("doubtful: b")
    assert scores["verdict_one"] == Score(1, "as given", 4)


def test_a_verdict_draws_from_no_global_state_and_repeats(run: Run) -> None:
    before = torch.get_rng_state(), random.getstate(), np.random.get_state()[1].copy()  # noqa: NPY002
    first = run.verdict()
    assert torch.equal(before[0], torch.get_rng_state()) and before[1] == random.getstate()
    assert np.array_equal(before[2], np.random.get_state()[1])  # noqa: NPY002
    assert run.verdict() == first


def test_a_run_of_two_steps_has_failed(run: Run) -> None:
    verdict = run.verdict()
    assert verdict.word == "failed" and {"views", "match", "variety", "pieces", "empty"} <= {
        f.name for f in verdict.findings
    }


def test_true_shapes_are_good(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Except that nobody found their views."""
    shapes = chairs(CHAIRS, SIZE, seed=3)
    monkeypatch.setattr(type(run.generator), "sample", lambda self, n, seed=0: shapes[torch.arange(n) % CHAIRS])
    words = {f.name: f.word for f in run.verdict().findings}
    assert words["match"] == words["variety"] == words["empty"] == "good" and words["likeness"] != "failed"
    assert words["views"] == "doubtful"


def test_silhouettes_that_are_their_own_mirror_images_are_named(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    post = torch.zeros(12, 1, SIZE, SIZE)
    post[..., 2:-2, 4:-4] = 1
    (state,) = run.assignments()
    certain = torch.eye(BINS)[torch.arange(12) % BINS]
    monkeypatch.setattr(type(state), "_of", lambda self, images: certain)
    assert "mirror" in {f.name for f in state.findings(post, post)}
    corner = post.tril()
    assert "mirror" not in {f.name for f in state.findings(corner, corner)}


def test_known_views_are_judged_by_their_labels(tmp_path: Path) -> None:
    recipe = toy(steps=1, views="known")
    verdict = train(recipe, tmp_path, quiet=True).verdict()
    names = {f.name for f in verdict.findings}
    assert {"labels", "sides"} <= names and "views" not in names


def test_held_out_pictures_are_used_if_there_are_any() -> None:
    panel = only_panel(RECIPE)
    images, rows = held_out_images(panel, 0)
    assert torch.equal(panel.batch(rows), images) and len(images) == 2 * CHAIRS
    black = Collection(torch.zeros(12, 1, SIZE, SIZE))
    images, rows = held_out_images(replace(panel, held_out=black), 0)
    assert sorted(rows.tolist()) == list(range(12)) and len(images) == 12 and not images.any()


@pytest.mark.parametrize("held_out, looked_at", [(9, 128), (150, 150)])
def test_views_are_judged_by_training_pictures_too_if_few_are_held_out(
    held_out: int, looked_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    some, more = Collection(torch.rand(held_out, 1, SIZE, SIZE)), Collection(torch.rand(200, 1, SIZE, SIZE))
    panel = Panel(only_panel(RECIPE).observations, more, Predicted(), held_out=some)
    state = panel.assignment.begin(panel, 0)
    seen: list[torch.Tensor] = []
    monkeypatch.setattr(type(state), "findings", lambda self, real, generated: seen.append(real) or [])
    x = chairs(4, SIZE)
    panel_findings(Volumes(), state, x, 0)
    assert len(seen[0]) == looked_at
    assert torch.equal(seen[0][:held_out], held_out_images(panel, 0)[0])


def test_no_training_picture_counts_twice_if_none_are_held_out(monkeypatch: pytest.MonkeyPatch) -> None:
    panel = Panel(only_panel(RECIPE).observations, Collection(torch.rand(40, 1, SIZE, SIZE)), Predicted())
    state = panel.assignment.begin(panel, 0)
    seen: list[torch.Tensor] = []
    monkeypatch.setattr(type(state), "findings", lambda self, real, generated: seen.append(real) or [])
    panel_findings(Volumes(), state, chairs(4, SIZE), 0)
    assert len(seen[0]) == 40 == len(seen[0].flatten(1).unique(dim=0))


def test_pictures_of_the_same_object_are_near() -> None:
    panel = only_panel(RECIPE)
    near = are_near(panel, torch.arange(2 * CHAIRS), torch.arange(2 * CHAIRS))
    assert bool(near.diagonal().all()) and bool(near[0, :6].all()) and not bool(near[0, 7:].any())
    apart = [Collection(panel.batch(torch.arange(n))) for n in (10, 20)]
    two = Panel(panel.observations[:2], apart)
    near = are_near(two, torch.tensor([0, 29]), torch.tensor([10, 20, 29]))
    assert near.tolist() == [[True, False, False], [False, False, True]]  # row 10 begins the second collection


@pytest.mark.parametrize("names, near", [("{:05d}", True), ("chair_{:05d}#0", False), ("{:d}", False)])
def test_what_lay_near_a_held_out_picture_may_show_its_object(names: str, near: bool) -> None:
    """Unless names tell the object, or are in no order."""
    panel = only_panel(RECIPE)
    count = len(panel)
    collection = Collection(panel.batch(torch.arange(count)), names=[names.format(n) for n in range(count)])
    kept, held_out = collection.subset([n for n in range(count) if n not in (20, 21)]), collection.subset([20, 21])
    panel = Panel(panel.observations, kept, panel.assignment, held_out=held_out)
    found = held_out_near(panel, torch.arange(2), torch.arange(count - 2))
    if not near:
        assert not found.any()
        return
    within = int(MOST_NEAR * (count - 2))
    assert found[0].nonzero()[:, 0].tolist() == list(range(20 - within, 20 + within + 1))
    assert torch.equal(found[0], found[1])


def test_as_many_projections_as_training_pictures_that_count(run: Run) -> None:
    (state,) = run.assignments()
    seen = evidence(state, run.sample(8), 0)
    assert len(seen.generated) == len(seen.views) == round(seen.apart.float().sum(1).mean().item())
    assert seen.generated.shape[1:] == seen.real.shape[1:] and not bool(seen.apart.all())
    assert seen.views.max() < BINS and seen.real_views is None


def test_the_command_says_and_writes_the_verdict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    assert main(["train", TOY, "--steps", "2", "--out", str(run)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("verdict: ")]
    stored = json.loads((run / "verdict.json").read_text(), parse_constant=pytest.fail)
    assert line == f"verdict: {stored['line']}" and stored["step"] == 2 and stored["word"] == "failed"
    assert {"word", "value", "doubtful", "failed", "says", "next", "protocol"} == set(stored["findings"]["match"])
    assert stored["findings"]["views"]["failed"] is None
    assert main(["resume", str(run), "--trust", "--steps", "3", "--quiet"]) == 0
    assert "verdict" not in capsys.readouterr().out
    assert json.loads((run / "verdict.json").read_text())["step"] == 3
    resume(run, steps=4, trust=True, quiet=True)
    assert not (run / "verdict.json").exists()  # nobody judged the fourth step


def test_evaluate_prints_the_verdict(run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run"
    assert main(["train", TOY, "--steps", "1", "--quiet", "--out", str(path)]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(path), "--trust", "--n", "8"]) == 0
    out = capsys.readouterr().out
    assert "\nverdict: failed: " in out and "\n  match" in out
    assert main(["evaluate", str(path), "--trust", "--n", "8", "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)
    assert scores["verdict"]["value"] == 0.0 and {"verdict_match", "verdict_pieces", "diversity"} <= scores.keys()


def test_a_run_that_was_stopped_has_no_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.training.trainer.Trainer.stopping", lambda self: self.state.counters.step == 1)
    assert main(["train", TOY, "--steps", "3", "--quiet", "--out", str(tmp_path / "run")]) == 0
    assert not (tmp_path / "run" / "verdict.json").exists()


def test_a_verdict_that_fails_loses_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(self: object, x: torch.Tensor, seed: int = 0) -> list[Finding]:
        raise ZeroDivisionError("of my own")

    monkeypatch.setattr(Volumes, "findings", broken)
    assert main(["train", TOY, "--steps", "1", "--quiet", "--out", str(tmp_path / "run")]) == 0
    assert "no verdict (ZeroDivisionError: of my own)" in capsys.readouterr().out


def test_panels_are_told_apart(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    (state,) = run.assignments()
    alone = [f.name for f in judge(run.generator, run.domain, [state, state]).findings]
    assert alone.count("match") == 1 and "pieces" in alone  # of one kind
    monkeypatch.setattr(module, "by_name", lambda states: dict(zip(("a", "b"), states, strict=True)))
    names = [f.name for f in judge(run.generator, run.domain, [state, state]).findings]
    assert {"match_a", "match_b", "pieces"} <= {*names}


def test_few_pictures_are_doubtful_whatever_else_is_good(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "REAL", 3)
    findings = {f.name: f for f in run.verdict().findings}
    assert findings.keys() == {"few", "pieces", "empty"}
    assert (findings["few"].word, findings["few"].score.value) == ("doubtful", 3)


def test_findings_of_several_panels_name_theirs(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "panel_findings", lambda *_: [finding(1, "far off")])
    (state,) = run.assignments()
    alone, *_ = judge(run.generator, run.domain, [state]).findings
    monkeypatch.setattr(module, "by_name", lambda states: dict(zip(("a", "b"), states, strict=True)))
    first, *_ = judge(run.generator, run.domain, [state, state]).findings
    assert (alone.name, alone.says) == ("one", "far off") and (first.name, first.says) == ("one_a", "a: far off")


def test_a_run_with_too_few_pictures_is_doubtful(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "photos" / "flash"
    folder.mkdir(parents=True)
    for k in range(3):
        Image.new("RGB", (16, 16), (60 * k, 90, 30)).save(folder / f"{k}.png")
    words = [
        "--size",
        "16",
        "--channels",
        "8",
        "--discriminator-channels",
        "8",
        "--batch",
        "2",
        "--steps",
        "1",
        "--matching",
        "0",
    ]
    out = tmp_path / "run"
    assert main(["train", "wood", "--data", str(folder.parent), *words, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "verdict: doubtful: 2 pictures can be compared with others, which is too few to judge by; next: give" in said
    assert json.loads((out / "verdict.json").read_text())["findings"]["few"]["failed"] is None
