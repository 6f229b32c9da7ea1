"""What README.md and docs/usage.md tell people to type works: Python and commands, with smaller budgets."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import torch
from PIL import Image
from safetensors.torch import load_file, save_file

from unproject.cli import main
from unproject.data import chairs, observe
from unproject.projections.silhouette import azimuth_bins
from unproject.studio import Studio
from unproject.training.checkpoint import FORMAT

ROOT = Path(__file__).parent.parent
TUTORIAL = "docs/tutorials/lines.md"
"""Its Python writes the files of its commands."""
FIT = "docs/fit.md"
"""Some of its Python opens the runs of its commands."""
STUDIO = "docs/studio.md"
PAGES = ("README.md", "docs/usage.md", TUTORIAL, FIT, STUDIO)


def blocks(language: str, page: str = "README.md") -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of cut-outs in the current directory, and of textures and photographs, as the README supposes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Studio, "serve_forever", lambda self: None)  # it would until Ctrl-C
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    folder = tmp_path / "my_masks"
    folder.mkdir()
    seen = observe(chairs(12), azimuth_bins(4), seed=0)
    for name, picture in zip(seen.names, seen.items, strict=True):
        Image.fromarray((picture[0] * 255).to(torch.uint8).numpy()).save(folder / f"{name}.png")
    (tmp_path / "my_wood").mkdir()
    for name, value in (("Color", (120, 90, 60)), ("Roughness", (130, 130, 130)), ("NormalGL", (128, 128, 255))):
        Image.new("RGB", (16, 16), value).save(tmp_path / "my_wood" / f"Wood_{name}.png")
    for name in ("diffuse", "top", "flash"):
        (tmp_path / "my_photos" / name).mkdir(parents=True)
        for k in range(4):
            Image.effect_noise((70, 64), 60 + k).convert("RGB").save(tmp_path / "my_photos" / name / f"{k}.jpg")
    return folder


def test_the_python_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    codes = blocks("python")
    assert codes
    for code in codes:
        code = re.sub(r"\bchairs\(\d+", "chairs(20", code)
        code = re.sub(r"\b(steps|minutes)=[\d.]+", "steps=2, batch=4", code)
        exec(compile(code, "README.md", "exec"), {})
    for name in re.findall(r"[\w/]+\.(?:png|gif|npz|glb)", "".join(codes)):
        assert (tmp_path / name).stat().st_size > 0, name


def commands(page: str) -> list[str]:
    """Every command of a page that begins with `unproject`, in a virtual environment or not."""
    lines = (line.partition("#")[0].strip() for block in blocks("sh", page) for line in block.splitlines())
    return [line.removeprefix(".venv/bin/") for line in lines if re.match(r"(\.venv/bin/)?unproject ", line)]


ELSEWHERE = ("unproject demo", "unproject reproduce", "unproject data get")
"""Commands that take minutes or the network; they have tests of their own."""


LEAST_FIT = "--candidates 4 --starts 1 --steps 1 --tune 0 --no-novelty"


def shortened(command: str) -> str:
    """The command with the least budget and few samples."""
    verb = command.split()[1]
    command = re.sub(r"--(minutes|steps) [\d.]+", "", command)
    command = re.sub(r"--n \d+", "", command) if verb == "evaluate" else command
    command = command.replace("--ceiling", "")
    more = {
        "train": "--steps 2 --batch 4 --quiet",
        "resume": "--steps 3 --quiet",
        "evaluate": "--n 10",
        "fit": LEAST_FIT,
        "studio": "--port 0",
    }
    return f"{command} {more.get(verb, '')}"


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(masks: Path, page: str) -> None:
    """In their order, each with what those before it have left; what --out names is there afterwards."""
    tried = [command for command in commands(page) if not command.startswith(ELSEWHERE)]
    assert {"train", "fit" if page == FIT else "export"} <= {command.split()[1] for command in tried}
    codes = [*blocks("python", page)] if page in (TUTORIAL, FIT, STUDIO) else []
    names: dict[str, object] = {}
    for code in codes:
        if "up.load(" not in code:
            exec(compile(code, page, "exec"), names)
    for command in tried:
        words = shlex.split(shortened(command))[1:]
        if words[0] == "export" and (Path(words[1]) / "checkpoints").is_dir():
            fill_what_was_learned(Path(words[1]))
        if words[0] == "train" and "--out" not in words:
            words += ["--out", f"runs/{words[1]}-0"]
        assert main(words) == 0, command
        if "--out" in words:
            assert Path(words[words.index("--out") + 1]).exists(), command
    for code in codes:
        if "up.load(" in code:
            exec(compile(code, page, "exec"), names)
    assert masks.is_dir()


def fill_what_was_learned(run: Path) -> None:
    """Two steps leave volumes nearly transparent, and there is no mesh of nothing: raise the occupancy everywhere."""
    (newest,) = sorted((run / "checkpoints").glob("*.safetensors"))[-1:]
    tensors = load_file(newest)
    if tensors.get("average/bias", torch.zeros(2)).numel() > 1:
        return
    tensors["average/bias"] = torch.tensor(3.0)
    save_file(tensors, newest, metadata={"format": FORMAT})


@pytest.mark.parametrize("page", [*PAGES, "docs/results.md", "docs/conventions.md", "CONTRIBUTING.md"])
def test_every_file_a_page_links_to_exists(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\(((?!https?:)[^)#\s]+)(?:#[^)]*)?\)", text)
    missing = [link for link in links if not ((ROOT / page).parent / link).exists()]
    assert not missing
