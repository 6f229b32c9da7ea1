"""Sharing: what is written for others samples as the run does, names no folder, and comes back from a hub."""

from __future__ import annotations

import json
import shutil
import sys
import warnings
from fnmatch import fnmatch
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

import unproject as up
from unproject.cli import main
from unproject.report.contents import read_contents
from unproject.report.sections import commands_section
from unproject.sharing import example_path, hub, put_example, save_pretrained
from unproject.sharing.shared import small, without_paths
from unproject.training import checkpoint

MOST = 3_000_000


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "toy"
    flags = "--size 16 --channels 16 --rank 8 --batch 8 --steps 4 --tries 1"
    assert main(["train", "shapes", *flags.split(), "--quiet", "--out", str(out)]) == 0
    return out


def test_a_shared_run_samples_as_the_run_does(run: Path, tmp_path: Path) -> None:
    shared = save_pretrained(run, tmp_path / "shared")
    found, wanted = (up.load(path).sample(4, seed=3) for path in (shared, run))
    assert (found - wanted).abs().max() < 0.01


def test_a_shared_run_can_be_fitted_and_is_small(run: Path, tmp_path: Path) -> None:
    shared = save_pretrained(run, tmp_path / "shared")
    names = set(checkpoint.load(checkpoint.newest(shared / "checkpoints")))
    kinds = {name.split("/")[0] for name in names}
    assert kinds == {"average", "panels"} and not any("optimiser" in name for name in names)
    opened = up.load(shared)
    states = opened.assignments()
    before = up.load(run)
    assert states[0].views.equal(before.assignments()[0].views)
    sizes = [sum(file.stat().st_size for file in path.rglob("*.safetensors")) for path in (shared, run)]
    assert sizes[0] < sizes[1] / 3


def test_nothing_that_is_shared_names_a_folder_of_this_machine(run: Path, tmp_path: Path) -> None:
    copied = tmp_path / "run"
    shutil.copytree(run, copied)
    environment = json.loads((copied / "environment.json").read_text())
    (copied / "environment.json").write_text(json.dumps({**environment, "folder": str(tmp_path / "secret" / "x")}))
    shared = save_pretrained(copied, tmp_path / "shared")
    assert json.loads((shared / "environment.json").read_text())["folder"] == "x"
    for file in (*shared.glob("*.json"), shared / "README.md"):
        text = file.read_text()
        assert str(run.parent) not in text and str(tmp_path) not in text, file
    assert json.loads((shared / "environment.json").read_text())["command"][0]


def test_the_card_has_scores_and_where_it_comes_from(run: Path, tmp_path: Path) -> None:
    verdict = {"line": "good: yes", "findings": {"match": {"word": "good", "value": 1.0312, "protocol": "distance"}}}
    copied = tmp_path / "run"
    shutil.copytree(run, copied)
    (copied / "verdict.json").write_text(json.dumps(verdict))
    card = (save_pretrained(copied, tmp_path / "shared") / "README.md").read_text()
    assert card.startswith("---\nlibrary_name: unproject\n")
    assert "| match | 1.03 | good | distance |" in card and "good: yes" in card
    assert "| seed | 0 |" in card and "torch" in card and "samples/step-" in card
    assert (tmp_path / "shared" / "samples").is_dir()


def test_the_log_that_is_shared_is_short_and_whole(run: Path, tmp_path: Path) -> None:
    copied = tmp_path / "run"
    shutil.copytree(run, copied)
    lines = [json.dumps({"step": 1, "seconds": k, "loss_events": 1.0}) + "\n" for k in range(1, 1001)]
    (copied / "stats.jsonl").write_text("".join(lines) + '{"step": 1, "seconds": 1, "event": "assigned"}\n')
    with (copied / "stats.jsonl").open("ab") as stream:
        stream.write(b'{"step": 9, "seconds": 1, "loss\xff": 1}\n')  # a damaged line is no mistake of the user's
    shared = save_pretrained(copied, tmp_path / "shared")
    found = [json.loads(line)["seconds"] for line in (shared / "stats.jsonl").read_text().splitlines()]
    assert found[:2] == [1, 6] and len(found) == 200


class LocalHub:
    """A hub that is a folder."""

    def __init__(self, root: Path) -> None:
        self.root, self.private = root, {}

    def create_repo(self, name: str, private: bool, exist_ok: bool) -> str:
        self.private.setdefault(name, private)
        return f"hub:{name}"

    def repo_info(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(private=self.private[name])

    def upload_folder(self, repo_id: str, folder_path: Path, commit_message: str, delete_patterns: list[str]) -> None:
        there = self.root / repo_id
        for file in there.rglob("*"):
            if any(fnmatch(file.relative_to(there).as_posix(), pattern) for pattern in delete_patterns):
                file.unlink()
        shutil.copytree(folder_path, self.root / repo_id, dirs_exist_ok=True)

    def snapshot_download(self, name: str, revision: str | None, allow_patterns: list[str]) -> str:
        if not (self.root / name).is_dir():
            raise FileNotFoundError(f"404: {name}")
        return str(self.root / name)


def test_a_run_goes_to_a_hub_and_comes_back(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    local = LocalHub(tmp_path)
    monkeypatch.setattr(hub, "_hub", lambda: local)
    assert up.push_to_hub(run, "me/chairs", api=local) == "hub:me/chairs"
    assert local.private == {"me/chairs": True}
    assert 'from_pretrained("me/chairs")' in (tmp_path / "me" / "chairs" / "README.md").read_text()
    found = up.from_pretrained("me/chairs").sample(2)
    assert (found - up.load(run).sample(2)).abs().max() < 0.01
    with pytest.raises(up.UserError, match="you/none: cannot be fetched"):
        up.from_pretrained("you/none")


def test_a_run_on_the_hub_is_replaced_whole(run: Path, tmp_path: Path) -> None:
    local, there = LocalHub(tmp_path), tmp_path / "me" / "chairs"
    for folder in ("checkpoints", "samples", "notes"):
        (there / folder).mkdir(parents=True)
    names = ("checkpoints/step-000000009.safetensors", "samples/step-000000009.png", "verdict.json", "notes/mine.json")
    for name in (*names, ".gitattributes"):
        (there / name).write_text("of before")
    up.push_to_hub(run, "me/chairs", api=local)
    kept = {path.relative_to(there).as_posix() for path in there.rglob("*") if path.is_file()}
    assert len([name for name in kept if name.startswith(("checkpoints/", "samples/"))]) == 2
    assert not kept & set(names[:2]) and {"notes/mine.json", ".gitattributes"} <= kept
    assert up.load(there).step == 4


def test_a_private_run_is_not_put_where_all_see_it(run: Path, tmp_path: Path) -> None:
    local = LocalHub(tmp_path)
    local.private["me/chairs"] = False
    with pytest.raises(up.UserError, match="^me/chairs: exists and is public; give --public or another name$"):
        up.push_to_hub(run, "me/chairs", api=local)
    assert not (tmp_path / "me").exists()
    up.push_to_hub(run, "me/chairs", private=False, api=local)
    assert (tmp_path / "me" / "chairs" / "README.md").is_file()


@pytest.mark.parametrize("path", ["C:\\Users\\me\\masks", "D:/me/masks", "\\\\server\\me\\masks", "/data/me/masks"])
def test_paths_of_either_system_are_shortened(path: str) -> None:
    assert without_paths({"data": path, "kept": ["masks", "a/b"]}) == {"data": "masks", "kept": ["masks", "a/b"]}


@pytest.mark.parametrize(
    "path", ["~/acme/masks", "~me/acme/masks", "./acme/masks", "..\\acme\\masks", "file:///acme/masks"]
)
def test_paths_that_begin_anywhere_are_shortened(path: str) -> None:
    assert without_paths([path, "~3 nats", "1/2"]) == ["masks", "~3 nats", "1/2"]


def test_relative_paths_of_a_recipe_are_not_shared() -> None:
    """What a generator is built from stays: it would not be built without."""
    call = {"call": "mine:Shapes", "positional": [], "arguments": {"pooling": "mean/max"}}
    recipe = {"recipe": "mine:scans", "arguments": {"data": {"path": "clients/acme"}}, "resolved": {"generator": call}}
    assert without_paths(recipe) == {**recipe, "arguments": {"data": {"path": "acme"}}}


def test_code_that_is_not_shared_is_named(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    copied = tmp_path / "run"
    shutil.copytree(run, copied)
    recipe = json.loads((run / "recipe.json").read_text())
    assert recipe["resolved"]["generator"]["call"] == "unproject.networks.low_rank:LowRankGenerator"
    recipe["resolved"]["generator"]["call"] = "sharing_of_mine:LowRankGenerator"
    (copied / "recipe.json").write_text(json.dumps(recipe))
    (tmp_path / "sharing_of_mine.py").write_text("from unproject.networks import LowRankGenerator\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert main(["share", str(copied), "--trust", "--out", str(tmp_path / "shared")]) == 0
    told = "others need code that is not in it: sharing_of_mine:LowRankGenerator; give it to them, and tell them of"
    assert told in capsys.readouterr().out
    card = (tmp_path / "shared" / "README.md").read_text()
    assert '("OWNER/NAME", trust=True)' in card and "`sharing_of_mine:LowRankGenerator`" in card
    save_pretrained(run, tmp_path / "ours")
    assert "trust" not in (tmp_path / "ours" / "README.md").read_text()


def test_the_hub_has_what_is_called(tmp_path: Path) -> None:
    """The stand-in takes what the package's own methods take."""
    import inspect

    package = pytest.importorskip("huggingface_hub")
    for own, method in (
        (LocalHub.create_repo, package.HfApi.create_repo),
        (LocalHub.upload_folder, package.HfApi.upload_folder),
        (LocalHub.repo_info, package.HfApi.repo_info),
    ):
        assert set(inspect.signature(own).parameters) - {"self", "name"} <= set(inspect.signature(method).parameters)
    wanted = {"revision", "allow_patterns"}
    assert wanted <= set(inspect.signature(package.snapshot_download).parameters)


def test_without_the_package_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(up.UserError, match=r"pip install 'unproject\[hub\]'"):
        up.from_pretrained("me/chairs")


WRONG = {
    "both": (["--out", "x", "--push", "a/b"], "give either"),
    "neither": ([], "give either"),
    "no name": (["--push", "chairs"], "give OWNER/NAME"),
}


@pytest.mark.parametrize("words, says", WRONG.values(), ids=list(WRONG))
def test_what_cannot_be_shared(run: Path, words: list[str], says: str, capsys: Any, monkeypatch: Any) -> None:
    assert main(["share", str(run), *words]) == 2
    assert says in capsys.readouterr().err


def test_a_folder_that_is_not_empty_is_left_alone(run: Path, tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "kept").write_text("kept")
    assert main(["share", str(run), "--out", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_numbers_that_16_bits_do_not_hold_keep_32() -> None:
    assert small(torch.tensor([1e6, 0.0])).dtype == torch.float32
    assert small(torch.tensor([1.0, 0.0])).dtype == torch.float16
    assert small(torch.tensor([3, 255])).dtype == torch.uint8 and small(torch.tensor([-1, 2])).dtype == torch.int64


def test_the_run_that_comes_with_the_package_is_small_and_good(tmp_path: Path) -> None:
    path = example_path("chairs")
    assert sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) < MOST
    assert json.loads((path / "verdict.json").read_text())["word"] == "good"
    put = put_example("chairs", tmp_path / "runs")
    assert put_example("chairs", tmp_path / "runs") == put
    x = up.from_pretrained("chairs").sample(4, largest_part=True)
    assert not up.Volumes().empty(x).any()
    assert x.equal(up.load(put).sample(4, largest_part=True))


def test_the_data_of_the_run_that_comes_with_the_package_are_known_again(tmp_path: Path) -> None:
    """On any processor: they are compared by sketches. A false alarm would be the first that a newcomer sees."""
    run = up.load(put_example("chairs", tmp_path / "runs"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert run.with_recipe().given is not None


def test_relative_paths_of_the_command_are_not_shared(run: Path, tmp_path: Path) -> None:
    moved = tmp_path / "run"
    shutil.copytree(run, moved)
    environment = json.loads((moved / "environment.json").read_text())
    command = ["unproject", "train", "shapes", "--data", "../clients/acme/masks", "--probes=~/secret/lamps.hdr"]
    (moved / "environment.json").write_text(json.dumps({**environment, "command": command}))
    shared = save_pretrained(moved, tmp_path / "shared")
    written = "".join(file.read_text() for file in (shared / "environment.json", shared / "README.md"))
    assert "masks" in written and "--probes=lamps.hdr" in written
    assert not any(word in written for word in ("acme", "clients", "secret"))
    module = ["__main__.py", "train", "shapes", "--data", "my masks"]
    (moved / "environment.json").write_text(json.dumps({**environment, "command": module}))
    card = (save_pretrained(moved, tmp_path / "again") / "README.md").read_text()
    assert "| command | `unproject train shapes --data 'my masks'` |" in card


def test_a_run_that_cannot_be_shared_whole_is_not_shared(run: Path, tmp_path: Path, capsys: Any) -> None:
    moved = tmp_path / "run"
    shutil.copytree(run, moved)
    (moved / "environment.json").write_text("{")
    assert main(["share", str(moved), "--out", str(tmp_path / "shared")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: ") and "environment.json" in error and error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


ODD = {"verdict.json": {"findings": {"views": 3}, "line": 3}, "environment.json": {"command": 3, "packages": [1]}}


@pytest.mark.parametrize("name", ODD)
def test_files_of_a_run_that_hold_something_else(run: Path, tmp_path: Path, name: str, capsys: Any) -> None:
    shutil.copytree(run, tmp_path / "run")
    (tmp_path / "run" / name).write_text(json.dumps(ODD[name]))
    assert main(["share", str(tmp_path / "run"), "--out", str(tmp_path / "shared")]) == 0
    (tmp_path / "run" / name).write_text("[1]")
    assert main(["share", str(tmp_path / "run"), "--out", str(tmp_path / "other")]) == 2
    assert f"{name}: damaged (holds no object); " in capsys.readouterr().err and not (tmp_path / "other").exists()


def test_weights_are_shared_under_their_own_step(run: Path, tmp_path: Path) -> None:
    """Of the step that was opened, whatever training has written since; not at all once that step is gone."""
    copied = tmp_path / "run"
    shutil.copytree(run, copied)
    opened = up.load(copied)
    newest = checkpoint.newest(copied / "checkpoints")
    later = {name: torch.zeros_like(value) for name, value in checkpoint.load(newest).items()}
    checkpoint.save(copied / "checkpoints", opened.step + 1, later)
    shutil.copy(next((copied / "samples").iterdir()), copied / "samples" / "step-000000099.png")
    (copied / "verdict.json").write_text(json.dumps({"step": opened.step + 1, "line": "of later weights"}))
    with (copied / "stats.jsonl").open("a") as log:
        log.write('{"step": 99, "seconds": 9.0}\n')
    shared = save_pretrained(opened, tmp_path / "shared")
    assert (up.load(shared).sample(2) - opened.sample(2)).abs().max() < 0.01
    assert not (shared / "verdict.json").exists() and not (shared / "samples" / "step-000000099.png").exists()
    assert '"step": 99' not in (shared / "stats.jsonl").read_text()
    newest.unlink()
    with pytest.raises(up.UserError, match="its training has gone on"):
        save_pretrained(opened, tmp_path / "again")
    assert not (tmp_path / "again").exists()


def test_the_card_names_the_data(run: Path, tmp_path: Path) -> None:
    copied = tmp_path / "run"
    shutil.copytree(run, copied)
    recipe = json.loads((run / "recipe.json").read_text())
    recipe["arguments"]["data"] = {"path": "masks"}
    (copied / "recipe.json").write_text(json.dumps(recipe))
    assert "| data | masks |" in (save_pretrained(copied, tmp_path / "shared") / "README.md").read_text()


def test_a_card_has_the_folders_name_and_its_run_is_not_resumed(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["share", str(run), "--out", str(tmp_path / "my-chairs")]) == 0
    assert "\n# my-chairs\n" in (tmp_path / "my-chairs" / "README.md").read_text()
    assert main(["resume", str(tmp_path / "my-chairs"), "--steps", "9"]) == 2
    assert "weights alone, as of a shared run; begin a new run with train --from" in capsys.readouterr().err


def test_the_page_of_a_shared_run_offers_a_command_that_works(tmp_path: Path) -> None:
    """It has weights alone, from which `resume` cannot go on."""
    page = commands_section(read_contents(put_example("chairs", tmp_path / "runs")))
    assert "unproject resume" not in page and "unproject train shapes --from" in page


def test_no_folder_of_a_command_is_shared_however_it_is_named() -> None:
    words = ["unproject", "train", "shapes", "--data=/me/secret=1/masks", "--out", "/me/runs/x", "--minutes=3"]
    kept = without_paths({"command": words})["command"]
    assert kept == ["unproject", "train", "shapes", "--data=masks", "--out", "x", "--minutes=3"]
