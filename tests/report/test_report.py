"""The report: one file that says what a run is, whatever state the run is in, and lets nothing in that it holds run."""

from __future__ import annotations

import base64
import json
import math
import re
import shutil
import subprocess
from collections.abc import Callable
from functools import partial
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor, nn

from unproject.assignment import Panel
from unproject.cli import main
from unproject.cli._report import leave_report
from unproject.data import Collection, chairs, metal
from unproject.domains import Maps
from unproject.networks import Discriminator, Generator, LowRankGenerator
from unproject.ops.microfacet import Reflection
from unproject.projections import Identity, Rendering
from unproject.projections.observation import Observation
from unproject.report import write_report, writing
from unproject.report.contents import Contents, read_contents
from unproject.report.curves import charts_of
from unproject.report.materials import material_data
from unproject.report.sections import views_of
from unproject.training import Recipe, Run, load, train

SIDE = 16
SHAPES = {"volumes": (SIDE,) * 3, "images": (1, SIDE, SIDE), "maps": (8, SIDE, SIDE)}


class Flat(Generator):
    """A generator of a domain that is named when it is made: constants with a little noise."""

    def __init__(self, domain: str) -> None:
        super().__init__(4)
        self.domain = domain
        self.linear = nn.Linear(4, int(np.prod(SHAPES[domain])))

    def forward(self, code: Tensor) -> Tensor:
        return torch.sigmoid(self.linear(code)).view(-1, *SHAPES[self.domain])


def recipe(domain: str) -> Recipe:
    """A recipe that is given what it is to make: nothing is projected."""
    volumes = domain == "volumes"
    items = chairs(4, SIDE) if volumes else torch.rand(4, *SHAPES[domain], generator=torch.manual_seed(0))
    known = partial(LowRankGenerator, size=SIDE, channels=8, rank=4, code_size=4)
    return Recipe(
        known if volumes else partial(Flat, domain),
        [Panel([Observation("itself", Identity())], Collection(items))],
        discriminator=partial(Discriminator, channels=4, volumetric=volumes),
        steps=4,
        batch=2,
    )


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Run]:
    """A toy run of each domain, each trained once."""
    made: dict[str, Run] = {}

    def of(domain: str) -> Run:
        if domain not in made:
            made[domain] = train(recipe(domain), tmp_path_factory.mktemp(domain) / "run", quiet=True)
        return made[domain]

    return of


@pytest.fixture
def shapes(tmp_path: Path) -> Run:
    """A run of shapes that a test may damage."""
    return train(recipe("volumes"), tmp_path / "run", quiet=True)


class Elements(HTMLParser):
    """What a page is made of: every tag with its attributes, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.tags)


def viewer_data(page: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="viewer-data">(.*?)</script>', page)
    return json.loads(found[1]) if found else {}


# What it says


@pytest.mark.parametrize("domain", list(SHAPES))
def test_meshes_are_offered_of_shapes_alone(runs: Callable[[str], Run], tmp_path: Path, domain: str) -> None:
    page = write_report(runs(domain), tmp_path / "report.html").read_text()
    assert ("--to glb" in page) == (domain == "volumes")


@pytest.mark.parametrize(
    "told, kind",
    [
        ({}, "volumes"),
        ({"domain": {"type": "unproject.domains.images:Images"}}, "images"),
        ({"domain": {"type": "mine:Signals"}}, ""),
        ({"generator": {"call": "mine:Shapes"}}, ""),
        ({"generator": {"call": "os:system"}}, ""),
        ({"generator": 3}, ""),
        ({"domain": 3}, ""),
        ({"domain": {"type": ["a"]}}, ""),
    ],
)
def test_what_a_run_makes_is_told_without_code_of_the_users(shapes: Run, told: dict[str, object], kind: str) -> None:
    stored = json.loads((shapes.path / "recipe.json").read_text())
    stored["resolved"] |= told
    (shapes.path / "recipe.json").write_text(json.dumps(stored))
    assert read_contents(shapes.path).kind == kind


TITLES = ("Verdict", "Samples", "Samples over time", "Training", "Data", "Commands", "Environment")


@pytest.mark.parametrize("domain", list(SHAPES))
def test_every_section_is_there_and_nothing_is_loaded(runs: Callable[[str], Run], tmp_path: Path, domain: str) -> None:
    page = write_report(runs(domain), tmp_path / "report.html").read_text()
    assert [title for title in TITLES if f"<h2>{title}</h2>" not in page] == []
    elements = Elements(page)
    addresses = [value for _, found in elements.tags for name, value in found.items() if name in ("src", "href")]
    assert addresses and all(str(address).startswith("data:image/webp;base64,") for address in addresses)
    assert elements.count("link") == elements.count("iframe") == 0
    assert "url(" not in page and "@import" not in page
    assert "default-src &#x27;none&#x27;" in page or "default-src 'none'" in page


def test_a_shape_can_be_turned(runs: Callable[[str], Run], tmp_path: Path) -> None:
    data = viewer_data(write_report(runs("volumes"), tmp_path / "report.html").read_text())
    assert data.get("kind") in ("shapes", None)  # what is learned in four steps may be empty
    for item in data.get("items", []):  # pyright: ignore[reportGeneralTypeIssues]
        points = np.frombuffer(base64.b64decode(item["points"]), "<i2").reshape(-1, 3)
        faces = np.frombuffer(base64.b64decode(item["faces"]), "<u2").reshape(-1, 3)
        assert faces.max() < len(points) and len(faces) == item["triangles"]


def test_a_chair_is_drawn_as_the_mesh_that_is_exported() -> None:
    from unproject.report.shapes import shape_data

    (item,) = shape_data(torch.as_tensor(chairs(1, 32)), 8)["items"]
    points = np.frombuffer(base64.b64decode(item["points"]), "<i2").reshape(-1, 3) / 32767
    solid = np.argwhere(np.asarray(chairs(1, 32)[0]) > 0.5)
    ends = (solid.min(0) + [0, 0, 0]) / 16 - 1, (solid.max(0) + 1) / 16 - 1
    assert np.abs(points.min(0) - ends[0]).max() < 0.08 and np.abs(points.max(0) - ends[1]).max() < 0.08


def test_samples_are_counted_as_export_counts_them() -> None:
    from unproject.report.shapes import shape_data

    shapes = torch.stack(
        [torch.as_tensor(chairs(1, 32)[0]), torch.zeros(32, 32, 32), torch.as_tensor(chairs(1, 32)[0])]
    )
    assert [item["name"] for item in shape_data(shapes, 8)["items"]] == ["sample 0", "sample 2"]
    assert [item["name"] for item in material_data(metal(2, 16), Maps())["items"]] == ["sample 0", "sample 1"]


def test_a_material_can_be_lit(runs: Callable[[str], Run], tmp_path: Path) -> None:
    data = viewer_data(write_report(runs("maps"), tmp_path / "report.html").read_text())
    assert (data["kind"], data["width"], data["height"]) == ("materials", SIDE, SIDE)
    first = data["items"][0]  # pyright: ignore[reportIndexIssue]
    assert len(base64.b64decode(first["colour"])) == len(base64.b64decode(first["relief"])) == 4 * SIDE * SIDE


@pytest.mark.parametrize("coloured", [False, True])
def test_a_texel_is_shaded_as_the_operator_does(coloured: bool, tmp_path: Path) -> None:
    """By the viewer's formula without WebGL, up to its eight bits."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    maps = metal(1, 16, seed=3, coloured=coloured)
    maps[:, 3:-4] *= torch.tensor([1.0, 0.6, 0.3])[: maps.shape[1] - 7, None, None]
    data = material_data(maps, Maps())
    assert ("tint" in data["items"][0]) == coloured
    assets = files("unproject.report") / "assets"
    x, y, length = -0.3, 0.4, math.sqrt(0.3**2 + 0.4**2 + 0.8**2)
    light = [x / length, y / length, 0.8 / length]
    script = f"""
        const data = {json.dumps(data)}, light = {light}, item = data.items[0], seen = [];
        const maps = [item.colour, item.relief, item.tint].map((bytes) => bytes && unpack(bytes, Uint8Array));
        for (let p = 0; p < 256; p++) {{
          const here = maps.map((map) => map && map.subarray(4 * p, 4 * p + 4));
          const at = [((p % 16) + 0.5) / 16, (Math.floor(p / 16) + 0.5) / 16];
          seen.push(shadeTexel(...here, at, light, 1, data.model));
        }}
        console.log(JSON.stringify(seen));"""
    text = "\n".join((assets / name).read_text().replace('"use strict";', "") for name in ("viewer.js", "materials.js"))
    (tmp_path / "seen.js").write_text(text + script)
    said = subprocess.run([node, tmp_path / "seen.js"], capture_output=True, text=True, check=True).stdout
    found = torch.tensor(json.loads(said)).T.view(3, 16, 16)
    theta = {"view": 0.0, "light": math.acos(light[2]), "light_azimuth": math.atan2(y, x)}
    lamp = Rendering("directional", Reflection("albedo"))
    wanted = lamp(maps, **{name: torch.tensor([value]) for name, value in theta.items()})[0]
    assert (found - wanted).abs().mean() < 0.01 and (found - wanted).abs().max() < 0.1


def test_images_have_no_viewer(runs: Callable[[str], Run], tmp_path: Path) -> None:
    page = write_report(runs("images"), tmp_path / "report.html").read_text()
    assert viewer_data(page) == {} and "<canvas" not in page


def test_the_same_run_gives_the_same_page(runs: Callable[[str], Run], tmp_path: Path) -> None:
    run, state = runs("maps"), torch.get_rng_state()
    pages = [write_report(run, tmp_path / name).read_bytes() for name in ("a.html", "b.html")]
    assert pages[0] == pages[1]
    assert torch.get_rng_state().equal(state)


def test_it_is_left_in_the_run_and_no_other_file(shapes: Run) -> None:
    before = {path for path in shapes.path.rglob("*") if path.is_file()}
    assert write_report(shapes) == shapes.path / "report.html"
    assert {path for path in shapes.path.rglob("*") if path.is_file()} - before == {shapes.path / "report.html"}


# Its size


def test_many_large_pictures_make_no_large_page(shapes: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = np.random.default_rng(0)
    for step in range(1, 41):
        picture = noise.integers(0, 256, (640, 640, 3), dtype=np.uint8)
        Image.fromarray(picture).save(shapes.path / "samples" / f"step-{step:07d}.png")
    page = write_report(shapes)
    assert page.stat().st_size < 5_000_000
    frames = page.read_text().count('class="frame"')
    monkeypatch.setattr(writing, "MAX_PAGE_BYTES", page.stat().st_size)
    assert write_report(shapes).read_text().count('class="frame"') < frames


# What is hostile


HOSTILE = '</script><script>alert("1")</script><img src=x onerror=alert(2)>\'"&'


def test_what_a_run_holds_cannot_become_markup(shapes: Run, tmp_path: Path) -> None:
    expected = Elements(write_report(shapes, data=False).read_text()).count("script")
    folder = shapes.path.rename(tmp_path / HOSTILE.replace("/", "\\"))
    environment = json.loads((folder / "environment.json").read_text())
    (folder / "environment.json").write_text(
        json.dumps(environment | {"command": ["unproject", HOSTILE], "commit": HOSTILE, "processor": HOSTILE})
    )
    (folder / "verdict.json").write_text(
        json.dumps({"word": HOSTILE, "line": HOSTILE, "findings": {HOSTILE: {"word": HOSTILE, "says": HOSTILE}}})
    )
    (folder / "stats.jsonl").write_text(
        "".join(json.dumps({"step": k, "seconds": k, HOSTILE: k + 0.5}) + "\n" for k in range(4))
    )
    elements = Elements(write_report(folder, data=False).read_text())
    assert elements.count("script") == expected
    assert all("onerror" not in attributes for _, attributes in elements.tags)
    assert HOSTILE in "".join(elements.words)


def test_only_its_own_scripts_may_run(runs: Callable[[str], Run], tmp_path: Path) -> None:
    page = write_report(runs("maps"), tmp_path / "report.html").read_text()
    policy = next(str(a["content"]) for t, a in Elements(page).tags if a.get("http-equiv"))
    assert "unsafe" not in policy and policy.count("'sha256-") == page.count("<script>") + 1


def test_a_name_that_utf8_cannot_hold(shapes: Run) -> None:
    environment = json.loads((shapes.path / "environment.json").read_text())
    (shapes.path / "environment.json").write_text(json.dumps(environment | {"commit": "\ud800"}))
    assert "?" in write_report(shapes).read_text(encoding="utf-8")


# What is broken


def damaged(run: Path, kind: str) -> None:
    """Damage a run in one way."""
    if kind == "weights":
        newest = max((run / "checkpoints").iterdir())
        newest.write_bytes(newest.read_bytes()[:100])
    elif kind == "no checkpoint":
        for file in (run / "checkpoints").iterdir():
            file.unlink()
    elif kind == "log":
        with (run / "stats.jsonl").open("a") as file:
            file.write('{"step": 3, "sec')
    elif kind == "no log":
        (run / "stats.jsonl").unlink()
    elif kind == "environment":
        (run / "environment.json").write_text("[")
    elif kind == "verdict":
        (run / "verdict.json").write_text("{}")
    elif kind == "older verdict":
        (run / "verdict.json").write_text('{"step": 0, "word": "good", "line": "good: all of it"}')
    elif kind == "pictures":
        (run / "samples" / "step-0000001.png").write_bytes(b"PNG")
    elif kind == "unfinished":
        stored = json.loads((run / "recipe.json").read_text())
        stored["resolved"]["steps"] = 1000
        (run / "recipe.json").write_text(json.dumps(stored))


SAID = {
    "weights": "There are no samples: ",
    "no checkpoint": "There is no checkpoint yet",
    "log": "1 of 1 lines of stats.jsonl are damaged",
    "no log": "stats.jsonl is damaged or missing",
    "environment": "environment.json is damaged or missing",
    "verdict": "verdict.json is damaged or missing",
    "older verdict": "verdict.json is on step 0, not on 4: `unproject evaluate` judges the run again",
    "pictures": "1 pictures of samples/ are damaged",
    "unfinished": "This run is not finished: 0% of its budget",
}


@pytest.mark.parametrize("kind", list(SAID))
def test_a_run_that_is_broken_or_unfinished_is_told(shapes: Run, kind: str) -> None:
    damaged(shapes.path, kind)
    page = write_report(shapes.path).read_text()
    assert SAID[kind] in page and "all of it" not in page
    assert "<h2>Commands</h2>" in page


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(tmp_path)]) == 2
    assert "not a run directory (no recipe.json)" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_as_the_file_is_refused(shapes: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(shapes.path), "--out", str(tmp_path)]) == 2
    assert "is a folder; give the name of a file" in capsys.readouterr().err


# At the end of training


def test_training_leaves_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    toy = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}:toy"
    assert main(["train", toy, "--views", "known", "--steps", "2", "--out", str(tmp_path / "run")]) == 0
    assert f"report: {tmp_path / 'run' / 'report.html'}" in capsys.readouterr().out
    assert "<h2>Data</h2>" in (tmp_path / "run" / "report.html").read_text()


def test_a_report_that_fails_fails_no_training(
    shapes: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("unproject.report.write_report", full)
    leave_report(shapes, quiet=False)
    assert capsys.readouterr().err.startswith("warning: no report ([Errno 28] No space left on device); unproject")


def test_a_run_is_complete_once_what_is_not_logged_fits_into_its_budget() -> None:
    """Two intervals of the log at most; a long training is not taken for finished before that."""

    def left(*seconds: float) -> bool:
        lines = [{"step": 20 * (k + 1), "seconds": value} for k, value in enumerate(seconds)]
        return Contents(Path(), {"resolved": {"minutes": 10}}, {}, lines, None, [], 20).complete

    assert left(570, 581) and left(605) and not left(530, 540) and not left(589) and not left()


def test_curves_of_several_panels_are_named_by_them() -> None:
    lines = [{"step": step, "mismatch": 1.0, "mismatch/1": 0.5, "a/b": 2.0, "x": 1.0} for step in (1, 2)]
    assert [chart.title for chart in charts_of(lines, ["diffuse", "flash"])] == [
        "Mismatch of statistics, diffuse",
        "Mismatch of statistics, flash",
        "a/b",
        "x",
    ]
    assert charts_of(lines)[1].title == "mismatch/1"


def test_views_whose_numbers_are_beyond_all_bounds_have_no_angles() -> None:
    prior = {"name": "azimuth", "low": 10**400, "high": 10**400}
    labels, unit = views_of([{"observations": [{"prior": prior}, {"prior": prior}]}], 0, 2)
    assert len(labels) == 2 and "degrees" not in unit


def test_seconds_that_no_training_took_are_no_advice(shapes: Run, tmp_path: Path) -> None:
    copied = tmp_path / "copied"
    shutil.copytree(shapes.path, copied)
    with (copied / "stats.jsonl").open("a", encoding="utf-8") as log:
        log.write('{"step": 1, "seconds": 1.7e308}\n')
    assert "--minutes 1000000" in write_report(load(copied), tmp_path / "x.html").read_text(encoding="utf-8")
