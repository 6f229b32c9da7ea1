"""What the README tells people to type works: its Python and its commands, with smaller budgets."""

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
from unproject.training.checkpoint import FORMAT

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.fixture
def masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of cut-outs in the current directory, as the README supposes."""
    monkeypatch.chdir(tmp_path)
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
    (code,) = blocks("python")
    code = code.replace("chairs(500)", "chairs(20)").replace("steps=1000", "steps=2, batch=4")
    exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "runs/depth/chairs.png").stat().st_size > 0


def test_the_commands_of_the_readme_run(masks: Path) -> None:
    commands = [line for block in blocks("sh") for line in block.splitlines() if line.startswith(".venv/bin/unproject")]
    assert len(commands) >= 5
    for line in commands:
        command = re.sub(r"--minutes \d+", "--steps 2 --batch 4", line.partition("#")[0])
        command = command.replace("--batch 4", "") if " resume " in command else command
        command = command.replace("evaluate runs/mine", "evaluate runs/mine --n 4 --reference my_masks")
        command = command.replace("--ceiling", "--n 10").replace("evaluate runs/wood", "evaluate runs/wood --n 8")
        if " glb " in command:
            fill_what_was_learned(Path("runs/mine"))
        arguments = shlex.split(command)[1:]
        assert main(arguments) == 0, line
    assert masks.is_dir() and Path("sheet.png").exists() and list(Path("meshes").glob("*.glb"))
    assert all(Path(name).stat().st_size > 0 for name in ("wood.png", "wood.gif", "wood.glb"))


def fill_what_was_learned(run: Path) -> None:
    """Two steps leave volumes nearly transparent, and there is no mesh of nothing: raise the occupancy everywhere."""
    (newest,) = sorted((run / "checkpoints").glob("*.safetensors"))[-1:]
    tensors = load_file(newest)
    tensors["average/bias"] = torch.tensor(3.0)
    save_file(tensors, newest, metadata={"format": FORMAT})


def test_every_file_the_readme_links_to_exists() -> None:
    links = re.findall(r"\]\(((?!https?:)[^)#]+)\)", README)
    missing = [link for link in links if not (ROOT / link).exists()]
    assert links and not missing
