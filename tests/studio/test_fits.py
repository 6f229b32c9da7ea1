"""Fit and export in the studio: what is downloaded is what was asked for; uploads are guarded; one fit at a time."""

from __future__ import annotations

import io
import json
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from unproject.assignment import Panel
from unproject.cli import main
from unproject.data import Collection, wood
from unproject.domains import Maps
from unproject.inversion.novelty import combined
from unproject.projections import directions
from unproject.studio import explaining
from unproject.studio.answers import Request
from unproject.studio.downloads import attachment, exported
from unproject.studio.explore import space_of
from unproject.studio.server import respond
from unproject.studio.state import JOBS, State

Said = Callable[..., tuple[int, dict[str, Any]]]
PATIENCE = 200.0
"""Seconds that a fit may take on a busy machine."""


@pytest.fixture(scope="module", autouse=True)
def few_chairs() -> Iterator[None]:
    """Every fit makes the run's data again."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 150)
        yield


@pytest.fixture(scope="module")
def shapes(tmp_path_factory: pytest.TempPathFactory) -> State:
    """A run of shapes that learned a little."""
    folder = tmp_path_factory.mktemp("fitted")
    flags = (
        "--size 16 --channels 16 --rank 8 --batch 16 --steps 60 --views predicted --rate 0.005 --solid 0.5 --gamma 0.01"
    )
    words = ["train", "shapes", *flags.split(), "--ema-half-life", "0", "--out", str(folder / "chairs"), "--quiet"]
    assert main(words) == 0
    return State(folder)


def mask(width: int = 40) -> bytes:
    picture = np.zeros((64, 64), np.uint8)
    picture[10:54, 32 - width // 2 : 32 + width // 2] = 255
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "PNG")
    return content.getvalue()


def begun(state: State, said: Said, content: bytes, name: str = "seat.png", **query: Any) -> str:
    asked = {"run": "chairs", "name": name, "novelty": 0, **query}
    status, found = said(state, "/api/fit", "POST", content, **asked)
    assert status == 200, found
    return found["fit"]


def awaited(state: State, said: Said, fit: str, what: str) -> dict[str, Any]:
    """What is told of a fit once this is true of it; a fit takes five seconds of a processor that is not busy."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        _, found = said(state, "/api/fit", fit=fit)
        if found[what]:
            return found
        time.sleep(0.05)
    raise AssertionError(found)


def ended(state: State, said: Said, fit: str) -> dict[str, Any]:
    return awaited(state, said, fit, "ended")


def file_of(state: State, path: str, **query: Any) -> tuple[str, bytes]:
    answer = respond(state, "GET", path, Request({k: str(v) for k, v in query.items()}))
    assert answer.status == 200, answer.content
    assert answer.headers["Content-Disposition"].startswith("attachment; ")
    return answer.headers["Content-Disposition"].partition("filename=")[2].strip('"'), answer.content


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = explaining.Search(8, 2, 4, tune=0)
    monkeypatch.setattr(explaining, "SEARCHES", {"quick": quick, "thorough": quick})


def test_a_picture_is_explained_and_downloaded(shapes: State, said: Said, fast: None) -> None:
    fit = begun(shapes, said, mask())
    found = ended(shapes, said, fit)
    assert (found["stage"], found["error"], found["name"]) == ("done", "", "seat.png")
    assert len(found["explanations"]) == len(found["weights"]) == 2
    assert sum(found["posterior"]) == pytest.approx(1, abs=1e-3) and "azimuth" in found["views"][0][0]
    assert len(found["distances"]) == len(found["projections"]) == len(found["views"]) == 2
    assert (
        found["projections"][0] == found["projection"] != found["projections"][1]
    )  # that of the best is the fit's own
    assert said(shapes, "/api/fit/drawn", fit=fit)[1]["kind"] == "shapes"
    assert file_of(shapes, "/api/fit/file", fit=fit, to="glb", which=1)[0] == "seat-2.glb"
    name, content = file_of(shapes, "/api/fit/file", fit=fit, to="glb")
    assert name == "seat.glb"
    assert len(trimesh.load(io.BytesIO(content), file_type="glb", force="mesh").faces) > 50  # pyright: ignore


def test_a_view_says_nothing_where_a_run_found_its_views_itself(shapes: State, said: Said, fast: None) -> None:
    found = ended(shapes, said, begun(shapes, said, mask(), view="30"))
    assert found["stage"] == "failed" and found["error"].startswith("the given view cannot be used: this run found")


def test_what_it_finds_first_is_shown_while_it_goes_on(shapes: State, said: Said, monkeypatch: Any) -> None:
    monkeypatch.setattr(explaining, "SEARCHES", {"quick": explaining.Search(8, 2, 100000, tune=0)})
    fit = begun(shapes, said, mask())
    found = awaited(shapes, said, fit, "drawable")
    assert not found["ended"] and found["projection"] and said(shapes, "/api/fit/drawn", fit=fit)[0] == 200
    assert said(shapes, "/api/stop", "POST", b"", fit=fit)[0] == 200
    assert ended(shapes, said, fit)["stage"] == "stopped"


def half() -> bytes:
    content = io.BytesIO()
    Image.effect_noise((64, 64), 90).save(content, "PNG")
    return content.getvalue()[:1500]


BAD = {
    "text": ("x.png", b"no picture", "unreadable: no picture of a known format"),
    "half a picture": ("x.png", half(), "x.png: unreadable"),
    "nothing to be seen": ("x.png", mask(0), "x.png:"),
    "no array of silhouettes": ("x.npz", b"PK\x03\x04", "x.npz"),
}


@pytest.mark.parametrize("name, content, says", BAD.values(), ids=list(BAD))
def test_a_bad_upload_is_said(shapes: State, said: Said, fast: None, name: str, content: bytes, says: str) -> None:
    found = ended(shapes, said, begun(shapes, said, content, name))
    assert found["stage"] == "failed" and says in found["error"]
    assert "/tmp" not in found["error"] and "Traceback" not in found["error"]


REFUSED = {
    "suffix": ({"name": "x.exe"}, "drop a picture"),
    "search": ({"search": "endless"}, "choose from quick, thorough"),
    "run": ({"run": "../chairs"}, "there is no such run"),
}


@pytest.mark.parametrize("query, says", REFUSED.values(), ids=list(REFUSED))
def test_what_cannot_be_fitted_is_refused_at_once(shapes: State, said: Said, query: Any, says: str) -> None:
    status, found = said(shapes, "/api/fit", "POST", mask(), **{"run": "chairs", "name": "x.png", **query})
    assert status in (400, 404) and says in found["error"]


def test_a_view_that_is_none_is_said(shapes: State, said: Said, fast: None) -> None:
    error = ended(shapes, said, begun(shapes, said, mask(), view="north"))["error"]
    assert error.startswith("view north: give degrees of azimuth")  # there is a field of that name, and no flag


def test_what_training_pictures_tell_is_made_once_for_all_searches(
    shapes: State, said: Said, fast: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []
    monkeypatch.setattr(explaining.PictureReader, "novelty", lambda reader: made.append(1))
    for search in ("quick", "thorough"):
        found = ended(shapes, said, begun(shapes, said, mask(), novelty=1, search=search))
        assert found["stage"] == "done"
    assert len(made) == 1


def test_no_more_fits_wait_than_the_queue_holds(shapes: State, said: Said) -> None:
    go = threading.Event()
    held = shapes.jobs.submit(go.wait)
    while not held.running():
        time.sleep(0.001)
    begun_fits = [begun(shapes, said, mask()) for _ in range(JOBS)]
    status, found = said(shapes, "/api/fit", "POST", mask(), run="chairs", name="x.png")
    for fit in begun_fits:
        said(shapes, "/api/stop", "POST", b"", fit=fit)
        assert said(shapes, "/api/fit", fit=fit)[1]["stage"] == "stopped"  # at once, though another is being computed
    go.set()
    assert status == 503 and "wait a moment" in found["error"]
    assert {ended(shapes, said, fit)["stage"] for fit in begun_fits} == {"stopped"}


def test_a_fit_that_is_gone_says_so(shapes: State, said: Said) -> None:
    for path in ("/api/fit", "/api/fit/drawn", "/api/fit/file"):
        status, found = said(shapes, path, fit="none")
        assert status == 404 and "drop the picture again" in found["error"]


def test_what_is_exported_is_what_is_shown(shapes: State) -> None:
    place = {"run": "chairs", "pick": 3, "slides": "1,-0.5", "truncation": 0.8}
    name, content = file_of(shapes, "/api/export", to="npz", **place)
    space = space_of(shapes, Request({"run": "chairs"}))
    shown = space.run.domain.largest_part(space.samples(space.place(Request({k: str(v) for k, v in place.items()}))))
    assert name == "chairs-03-changed.npz"
    with np.load(io.BytesIO(content)) as arrays:
        assert np.allclose(arrays["volume"], shown.numpy())


def test_files_of_a_run_that_was_opened_itself_have_its_name(shapes: State) -> None:
    name, _ = file_of(State(shapes.folder.given / "chairs"), "/api/export", run=".", to="npz", pick=3)
    assert name == "chairs-03.npz"


def test_several_files_are_packed() -> None:
    maps = torch.as_tensor(wood(1, 16, 0)).float()
    answer = exported(Maps(), maps, "maps", "../new wood")
    assert 'filename="new-wood.zip"' in answer.headers["Content-Disposition"]
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        names = archive.namelist()
        assert json.loads(archive.read("new-wood/material.json"))["fresnel"] == "albedo"
    assert len([name for name in names if name.endswith(".png")]) >= 4
    assert not any(name.startswith(("/", "..")) for name in names)


def test_an_unknown_format_is_refused(shapes: State, said: Said) -> None:
    status, found = said(shapes, "/api/export", run="chairs", to="exe")
    assert status == 400 and "choose from" in found["error"]


def test_a_picture_of_the_run_is_explained(shapes: State, said: Said, fast: None) -> None:
    """One that was held out, and by itself: there are others of the same chair."""
    fit = begun(shapes, said, b"", "", own=7)
    found = ended(shapes, said, fit)
    held_out = shapes.opened("chairs").recipe().panels[0].held_out
    assert held_out is not None and found["stage"] == "done" and found["name"] == held_out.names[7]
    explanation: Any = shapes.kept(("fit", fit), lambda: None, 1)
    assert torch.equal(explanation.pictures, held_out.floats()[7:8])


def test_all_lines_of_an_image_of_the_run_are_explained(
    tmp_path: Path, said: Said, fast: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With their angles; and a panel of anchors is of no other kind, so that none is asked for."""
    lines = tmp_path / "scan.npz"
    np.savez(lines, sinograms=np.random.default_rng(0).random((12, 16, 3)) / 2, angle=np.array([0.0, 1.0, 2.0]))
    flags, anchors = "--bins 3 --channels 16 --batch 4 --steps 2 --quiet", ["--anchors", str(lines)]
    for name, more in (
        ("known", []),
        ("anchored", ["--views", "predicted", *anchors]),
        ("single", ["--views", "single", *anchors]),
    ):
        words = ["train", "digits", "--data", str(lines), *flags.split(), *more, "--out", str(tmp_path / "runs" / name)]
        assert main(words) == 0
    state, read = State(tmp_path / "runs"), explaining._read
    given: list[Any] = []
    monkeypatch.setattr(explaining, "_read", lambda *of: given.append(read(*of)) or given[-1])
    found = ended(state, said, begun(state, said, b"", "", run="known", own=4))
    assert (
        found["stage"] == "done"
        and len(given[0][0]) == 3
        and len({name.partition("#")[0] for name in given[0][0].names}) == 1
    )
    assert given[0][0].latents["angle"].tolist() == pytest.approx([0, 1, 2], abs=1e-5)
    for name in ("known", "anchored", "single"):
        kinds = said(state, "/api/kinds", run=name)[1]
        assert kinds["observations"] == [] and kinds["own"]


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> State:
    """A run of images by line integrals at three known angles."""
    folder = tmp_path_factory.mktemp("scans")
    lines, flags = folder / "scan.npz", "--bins 3 --channels 16 --batch 4 --steps 2 --quiet"
    np.savez(lines, sinograms=np.random.default_rng(0).random((12, 16, 3)) / 2, angle=np.array([0.0, 1.0, 2.0]))
    words = ["train", "digits", "--data", str(lines), *flags.split(), "--out", str(folder / "runs" / "scans")]
    assert main(words) == 0
    return State(folder / "runs")


def scan(factor: float = 1.0, objects: int = 1) -> bytes:
    content = io.BytesIO()
    lines = factor * np.random.default_rng(1).random((objects, 16, 3)) / 2
    np.savez(content, sinograms=lines, angle=np.array([0.0, 1.0, 2.0]))
    return content.getvalue()


def test_p_of_several_lines_is_that_of_the_command(
    scans: State, said: Said, fast: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One strange line of three is none that `unproject fit` finds strange."""
    p = torch.tensor([0.02, 0.5, 0.5])
    monkeypatch.setattr(
        explaining.PictureReader, "novelty", lambda reader: SimpleNamespace(p_values=lambda pictures: p)
    )
    found = ended(scans, said, begun(scans, said, scan(), "mine.npz", run="scans", novelty=1))
    assert found["p"] == pytest.approx(combined(p)) and found["p"] > found["levels"]["p"]
    assert "another kind" not in found["why"]


def test_what_is_to_be_known_of_a_file_is_said_in_the_page(
    scans: State, said: Said, fast: None, recwarn: pytest.WarningsRecorder
) -> None:
    for _ in range(2):  # not the first time only
        found = ended(scans, said, begun(scans, said, scan(40, 5), "mine.npz", run="scans"))
        assert found["remarks"][0] == "mine.npz holds 5 objects, of which the first is explained"
        assert found["remarks"][1].startswith("mine.npz: the largest reading is")
        assert found["remarks"][1].endswith("what to divide them by as scale") and len(found["remarks"]) == 2
    assert len(recwarn) == 0
    found = ended(scans, said, begun(scans, said, scan(40), "mine.npz", run="scans", scale=40))
    assert found["stage"] == "done" and found["remarks"] == []
    assert said(scans, "/api/fit", "POST", b"", run="scans", name="mine.npz", scale="x")[0] == 400


def test_fits_that_were_stopped_while_they_waited_leave_their_places_and_their_pictures(
    shapes: State, said: Said
) -> None:
    go = threading.Event()
    held = shapes.jobs.submit(go.wait)
    while not held.running():
        time.sleep(0.001)
    stopped = [begun(shapes, said, mask()) for _ in range(JOBS)]
    for fit in stopped:
        said(shapes, "/api/stop", "POST", b"", fit=fit)
        explanation: Any = shapes.kept(("fit", fit), lambda: None, 1)
        assert explanation.asked.content == b""
    again = [begun(shapes, said, mask()) for _ in range(JOBS)]
    assert said(shapes, "/api/fit", "POST", mask(), run="chairs", name="x.png")[0] == 503
    for fit in again:
        said(shapes, "/api/stop", "POST", b"", fit=fit)
    go.set()


def test_lines_without_a_common_name_are_of_different_images() -> None:
    """Collections number their items: the third of one has nothing to do with that of another."""
    lines = [torch.rand(4, 1, 8, generator=torch.Generator().manual_seed(k)) for k in range(3)]
    panel = Panel(directions(3), [Collection(part) for part in lines])
    assert torch.equal(explaining._own(10, panel).floats(), lines[1][3:4])  # pyright: ignore[reportPrivateUsage]


def test_the_report_is_stored_never_shown(shapes: State) -> None:
    name, content = file_of(shapes, "/api/report.html", run="chairs")
    assert name == "chairs.html" and content.startswith(b"<!doctype html>")


def test_the_views_of_all_pictures_are_downloaded(shapes: State) -> None:
    name, content = file_of(shapes, "/api/views.csv", run="chairs")
    assert name == "views.csv" and content.splitlines()[0].startswith(b"file,azimuth")


def test_a_run_of_a_newer_version_says_so(shapes: State, said: Said, tmp_path: Path) -> None:
    from safetensors.torch import save_file

    run = tmp_path / "newer"
    (run / "checkpoints").mkdir(parents=True)
    recipe = (shapes.folder.given / "chairs" / "recipe.json").read_text()
    (run / "recipe.json").write_text(recipe)
    save_file({"x": torch.zeros(1)}, run / "checkpoints" / "step-000000001.safetensors", {"format": "unproject-9"})
    state = State(tmp_path)
    says = "written by a newer version of unproject (unproject-9"
    assert says in said(state, "/api/runs")[1]["runs"][0]["said"]
    assert says in said(state, "/api/sample", run="newer")[1]["error"]


def test_a_download_keeps_names_of_any_script() -> None:
    told = attachment(b"", "椅子 a.glb").headers["Content-Disposition"]
    assert told == "attachment; filename=\"__-a.glb\"; filename*=UTF-8''%E6%A4%85%E5%AD%90-a.glb"
    told = attachment(b"", 'x"\r\nSet-Cookie: a.glb').headers["Content-Disposition"]
    assert told == 'attachment; filename="x-Set-Cookie-a.glb"'
