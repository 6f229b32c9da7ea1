"""What the README, guides and tutorials tell people to type works: Python and commands, with smaller budgets."""

from __future__ import annotations

import re
import shlex
import signal
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file, save_file
from torch.distributed.run import main as torchrun

from unproject.cli import main
from unproject.data import chairs, observe
from unproject.inversion.fitter import VIEW_STEPS
from unproject.projections.silhouette import azimuth_bins
from unproject.studio import Studio
from unproject.training.checkpoint import FORMAT

ROOT = Path(__file__).parent.parent
FIT = "docs/fit.md"
PAGES = {
    "README.md": {"train", "export"},
    "docs/usage.md": {"train", "export"},
    "docs/shapes.md": {"data", "train", "export"},
    "docs/materials.md": {"train", "render", "export"},
    "docs/start.md": {"studio", "export"},
    FIT: {"train", "fit"},
    "docs/studio.md": {"train", "export"},
    "docs/tutorials/cutouts.md": {"data", "train", "evaluate", "export", "fit"},
    "docs/tutorials/materials.md": {"data", "train", "render", "export"},
    "docs/tutorials/lines.md": {"data", "train", "export"},
    "docs/tutorials/operator.md": {"check", "train", "export"},
    "docs/tutorials/parts.md": {"train", "resume", "export"},
    "docs/tutorials/cluster.md": {"data", "train", "resume"},
}
"""Page → verbs that it has commands of."""
OTHERS = ("docs/how.md", "docs/results.md", "docs/trials.md", "docs/conventions.md", "CONTRIBUTING.md")
FRAGMENTS = ("README.md", "docs/usage.md")
"""Pages whose Python is not what their commands need; that of the README has a test of its own."""


def blocks(language: str, page: str = "README.md") -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of cut-outs in the current directory, and of textures and photographs, as the README supposes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Studio, "serve_forever", lambda self: None)  # it would until Ctrl-C
    # Reports and previews have tests of their own, and take longer than two steps.
    monkeypatch.setattr("unproject.cli._report.leave_report", lambda run, quiet: None)
    monkeypatch.setattr("unproject.domains.Volumes.preview", lambda self, x: Image.new("L", (1, 1)))
    # So do surfaces that are shaded from all around, and steps towards a view.
    monkeypatch.setattr(
        "unproject.export.pictures.render", lambda shape, a, e, size, _: np.zeros((size, size, 3), "u1")
    )
    monkeypatch.setattr("unproject.inversion.fitter.VIEW_STEPS", VIEW_STEPS[::4])
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    folder = tmp_path / "my_masks"
    folder.mkdir()
    seen = observe(chairs(4), azimuth_bins(4), seed=0)
    for name, picture in zip(seen.names, seen.items, strict=True):
        Image.fromarray((picture[0] * 255).to(torch.uint8).numpy()).save(folder / f"{name}.png")
    (tmp_path / "my_wood").mkdir()
    for name, value in (("Color", (120, 90, 60)), ("Roughness", (130, 130, 130)), ("NormalGL", (128, 128, 255))):
        Image.new("RGB", (16, 16), value).save(tmp_path / "my_wood" / f"Wood_{name}.png")
    (tmp_path / "my_copper").mkdir()
    for name, value in (("Color", (250, 208, 192)), ("Roughness", (130, 130, 130)), ("Metalness", (255, 255, 255))):
        Image.new("RGB", (16, 16), value).save(tmp_path / "my_copper" / f"Copper_{name}.png")
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
    """Every command of a page that runs `unproject`, in a virtual environment or not, in one process or several."""
    lines = (line.partition("#")[0].strip() for block in blocks("sh", page) for line in block.splitlines())
    begins = r"(\.venv/bin/)?unproject |(OMP_NUM_THREADS=1 )?torchrun "
    return [line.removeprefix(".venv/bin/") for line in lines if re.match(begins, line)]


ELSEWHERE = ("unproject demo", "unproject reproduce", "unproject data get")
"""Commands that take minutes or the network; they have tests of their own."""


LEAST_FIT = "--candidates 4 --starts 1 --steps 1 --tune 0 --no-novelty"


def verb_of(command: str) -> str:
    return command.rpartition("unproject ")[2].split()[0]


def shortened(command: str) -> str:
    """The command with the least budget and few samples."""
    verb = verb_of(command)
    command = re.sub(r"--(minutes|steps|batch) [\d.]+", "", command)
    command = re.sub(r"--n \d+", "", command) if verb == "evaluate" else command
    # Meshes are made of all that is drawn.
    if verb == "export" and re.search(r"--to (png|gif)|--out \S+\.(png|gif)", command):
        command = re.sub(r"--n \d+", "", command) + " --n 2"
    command = command.replace("--ceiling", "").replace("--size 1024", "--size 128")
    fewer = " --maps 8 --renderings 4" if re.search("train (wood|metal|plastic|fabric) (?!--data)", command) else ""
    fewer += " --channels 16" if re.search(r"train \w+ ", command) else ""
    more = {
        "train": f"--steps 2 --batch 4 --quiet{fewer}",
        "resume": "--steps 3 --quiet",
        "evaluate": "--n 10",
        "fit": LEAST_FIT,
        "studio": "--port 0",
    }
    return f"{command} {more.get(verb, '')}"


def smaller(code: str) -> str:
    """The Python of a page with a small data set."""
    code = re.sub(r"\bchairs\(\d{3,}", "chairs(12", code)
    return re.sub(r"(COUNT|shapes: int) = \d+", r"\1 = 6", code)


def run_python(code: str, page: str, names: dict[str, object]) -> None:
    """Run a block of Python; one that begins with the name of a file is saved there too."""
    code = smaller(code)
    if saved := re.match(r"# (\w+\.py)\n", code):
        Path(saved[1]).write_text(code, encoding="utf-8")
    exec(compile(code, page, "exec"), names)


def run_command(words: list[str]) -> None:
    if words[0] == "export" and (Path(words[1]) / "checkpoints").is_dir():
        fill_what_was_learned(Path(words[1]))
    if words[0] == "train" and "--out" not in words:
        words += ["--out", f"runs/{words[1]}-0"]
    assert main(words) == 0, words
    if "--out" in words:
        assert Path(words[words.index("--out") + 1]).exists(), words


def run_processes(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a command of torchrun, on processors: its agent in this process, which has torch already."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    handlers = {number: signal.getsignal(number) for number in numbers}
    try:
        torchrun(shlex.split(command.partition("torchrun ")[2]))  # raises when one of them fails
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(masks: Path, page: str, monkeypatch: pytest.MonkeyPatch, forked: None) -> None:
    """In their order, each with what those before it have left; what --out names is there afterwards."""
    tried = [command for command in commands(page) if not command.startswith(ELSEWHERE)]
    assert PAGES[page] <= {verb_of(command) for command in tried}
    codes = [] if page in FRAGMENTS else blocks("python", page)
    names: dict[str, object] = {}
    for code in codes:
        if "up.load(" not in code:
            run_python(code, page, names)
    for command in map(shortened, tried):
        if "torchrun " in command:
            run_processes(command, monkeypatch)
        else:
            run_command(shlex.split(command)[1:])
    for code in codes:
        if "up.load(" in code:
            run_python(code, page, names)
    assert masks.is_dir()


def fill_what_was_learned(run: Path) -> None:
    """Two steps leave volumes nearly transparent, and there is no mesh of nothing: raise the occupancy everywhere."""
    (newest,) = sorted((run / "checkpoints").glob("*.safetensors"))[-1:]
    tensors = load_file(newest)
    if tensors.get("average/bias", torch.zeros(2)).numel() > 1:
        return
    tensors["average/bias"] = torch.tensor(3.0)
    save_file(tensors, newest, metadata={"format": FORMAT})


@pytest.mark.parametrize("page", [*PAGES, *OTHERS])
def test_every_file_a_page_links_to_exists(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\(((?!https?:)[^)#\s]+)(?:#[^)]*)?\)", text)
    missing = [link for link in links if not ((ROOT / page).parent / link).exists()]
    assert not missing
