"""The page in a real browser: each panel, an upload, a run that is being written, bad inputs, and who is asked.

Skipped, by name, where there is no Chromium (Debian: apt-get install chromium) or no Playwright.
"""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from unproject import load
from unproject.assignment import Panel
from unproject.cli import main
from unproject.data import Collection, wood
from unproject.networks import Discriminator
from unproject.networks.materials import StationaryMaterials
from unproject.projections import Identity
from unproject.projections.observation import Observation
from unproject.studio import Studio, explaining
from unproject.training import Recipe, checkpoint, train
from unproject.training.lock import locked

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), ""
)
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]
PATIENCE = 60_000
"""Milliseconds that anything may take on a busy machine."""

if not CHROMIUM:
    pytest.skip("no Chromium is installed: the studio's page is not tested in a browser", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: no test in a browser")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of shapes and of a material, a broken one, one of a newer version, and one that is being written."""
    runs = tmp_path_factory.mktemp("runs")
    flags = (
        "--size 16 --channels 16 --rank 8 --batch 16 --steps 60 --views predicted --rate 0.005 --solid 0.5 --gamma 0.01"
        " --ema-half-life 0 --quiet"
    )
    for seed in ("3", "4", "5", "6", "7"):  # exports need samples that are not nearly empty; processors round otherwise
        assert main(["train", "shapes", *flags.split(), "--seed", seed, "--out", str(runs / "chairs")]) == 0
        if (load(runs / "chairs").sample(8) > 0.5).sum((1, 2, 3)).min() > 40:
            break
        shutil.rmtree(runs / "chairs")
    panel = Panel([Observation("itself", Identity())], Collection(torch.as_tensor(wood(4, 16, 0)).float()))
    generator, judge = partial(StationaryMaterials, size=16, channels=8), partial(Discriminator, channels=4)
    train(Recipe(generator, [panel], discriminator=judge, steps=2, batch=2), runs / "wood", quiet=True)
    (runs / "broken").mkdir()
    (runs / "broken" / "recipe.json").write_text("{")
    shutil.copytree(runs / "chairs", runs / "live")
    (runs / "live" / "verdict.json").unlink()
    recipe = json.loads((runs / "live" / "recipe.json").read_text())
    recipe["resolved"]["steps"] = 5000
    (runs / "live" / "recipe.json").write_text(json.dumps(recipe))
    return runs


@pytest.fixture(scope="module")
def studio(folder: Path) -> Iterator[Studio]:
    quick = explaining.Search(8, 2, 6, tune=0)
    before = explaining.SEARCHES
    explaining.SEARCHES = {"quick": quick, "thorough": quick}
    with Studio(folder) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()
    explaining.SEARCHES = before


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


class Tab:
    """A page, and what went wrong on it."""

    def __init__(self, page: Any, address: str) -> None:
        self.page, self.address = page, address
        self.asked: list[str] = []
        self.wrong: list[str] = []
        page.set_default_timeout(PATIENCE)
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("pageerror", lambda error: self.wrong.append(str(error)))

    def go(self, place: str) -> None:
        self.page.goto(f"{self.address}#/{place}")

    def trouble(self) -> str:
        """What the page says of what went wrong."""
        self.page.wait_for_selector("#trouble:not([hidden])")
        return self.page.text_content("#trouble")

    def until(self, text: str) -> None:
        """Wait for a text that is to be seen."""
        self.page.wait_for_function("text => document.body.innerText.includes(text)", arg=text)

    def held(self, requests: list[Any], count: int = 1) -> None:
        """Wait until so many requests are held back by a route."""
        while len(requests) < count:
            self.page.wait_for_timeout(50)

    def drawn(self) -> None:
        """Wait until the canvas shows something."""
        self.page.wait_for_selector(".stage canvas")
        self.page.wait_for_function("() => / ms\\./.test(document.querySelector('#panel').innerText)")


@pytest.fixture
def tab(chromium: Any, studio: Studio) -> Iterator[Tab]:
    context = chromium.new_context(viewport={"width": 1280, "height": 720})
    context.request.get(studio.address)  # brings the cookie
    one = Tab(context.new_page(), studio.address.partition("?")[0])
    yield one
    context.close()
    assert one.wrong == []
    elsewhere = [url for url in one.asked if not url.startswith((one.address, "data:", "blob:"))]
    assert elsewhere == []


def pixels(tab: Tab) -> str:
    return tab.page.evaluate("() => document.querySelector('.stage canvas').toDataURL()")


def test_runs_are_listed_and_two_are_shown_side_by_side(tab: Tab) -> None:
    tab.go("runs")
    tab.until("4 runs in")
    assert "damaged" in tab.page.text_content("article:has-text('broken')")
    for name in ("chairs", "wood"):
        tab.page.check(f"[aria-label='compare {name}']")
    tab.page.click("text=Compare two")
    tab.page.wait_for_selector(".side-by-side .run:nth-child(1) svg")
    tab.page.wait_for_selector(".side-by-side .run:nth-child(2) h1:text-is('wood')")
    assert "other=" in tab.page.url
    tab.page.wait_for_selector(".side-by-side .run:nth-child(1) img.sheet")


def test_the_printed_address_opens_it_from_a_link_of_another_site(chromium: Any, studio: Studio) -> None:
    """As one in a chat: what is chosen in the address stays, and the cookie lets the page ask."""
    context = chromium.new_context()
    one = Tab(context.new_page(), studio.address)
    one.page.route("http://chat.example/", lambda route: route.fulfill(body="a chat", content_type="text/html"))
    one.page.goto("http://chat.example/")
    one.page.evaluate("address => { location.href = address; }", f"{studio.address}#/runs?run=chairs")
    one.until("Samples over time")
    assert one.page.url == f"{studio.address.partition('?')[0]}#/runs?run=chairs"
    context.clear_cookies()
    one.page.reload()
    assert "the token is missing; open the address" in one.trouble()
    context.close()


def test_a_run_that_is_being_written_is_followed(tab: Tab, folder: Path) -> None:
    run = folder / "live"
    tab.go("runs?run=live")
    with locked(run):
        with (run / "stats.jsonl").open("a") as log:
            log.write(json.dumps({"step": 61, "seconds": 9.0, "loss_g": 0.5, "loss_d": 0.5}) + "\n")
        tab.until("training")
        Image.new("RGB", (64, 64), "red").save(run / "samples" / "step-000000777.png")
        tab.until("step 777")
        assert tab.page.is_hidden(".remarks") and "not finished" not in tab.page.inner_text("#panel")


@pytest.mark.parametrize("kind, links", [("maps", ["explore", "materials", "collections", "fit"]), ("", ["explore"])])
def test_a_run_has_links_to_the_panels_that_show_it(tab: Tab, kind: str, links: list[str]) -> None:
    """A run of a domain of one's own can be explored too."""

    def answer(route: Any) -> None:
        route.fulfill(json={**route.fetch().json(), "kind": kind})

    tab.page.route("**/api/run?*", answer)
    tab.go("runs?run=wood")
    tab.page.wait_for_selector(".links a")
    found = [link.get_attribute("href") for link in tab.page.locator(".links a").all()]
    assert found == [f"#/{panel}?run=wood" for panel in links]


@pytest.fixture
def another(folder: Path) -> Iterator[Callable[..., Path]]:
    """Makes a copy of a run, less some of its files, which is gone after the test."""
    made: list[Path] = []

    def copy(name: str, *less: str) -> Path:
        made.append(Path(shutil.copytree(folder / "chairs", folder / name, ignore=shutil.ignore_patterns(*less))))
        return made[-1]

    yield copy
    for run in made:
        shutil.rmtree(run)


def test_a_panel_waits_for_the_first_weights_and_then_opens(
    tab: Tab, folder: Path, another: Callable[..., Path]
) -> None:
    new = another("new", "checkpoints", "verdict.json", "samples")
    with locked(new):
        tab.go("explore?run=new")
        tab.until("It is training, and has made")
    assert tab.page.is_hidden("#trouble")
    whole = Path(shutil.copytree(folder / "chairs" / "checkpoints", new / "coming"))
    whole.rename(new / "checkpoints")  # as training does, which never shows half of one
    tab.drawn()


def test_shape_grid_and_file_are_of_one_step_until_newer_weights_are_asked_for(
    tab: Tab, another: Callable[..., Path]
) -> None:
    run = another("grows")
    tab.go("explore?run=grows")
    tab.drawn()
    tab.until("Sample 0 of step 60")
    shown = pixels(tab)
    other = checkpoint.load(run / "checkpoints" / "step-000000060.safetensors")
    for name, values in other.items():
        if name.startswith("average/planes") and values.is_floating_point():
            values.mul_(1.1)
    checkpoint.save(run / "checkpoints", 90, other)
    tab.until("there are weights of step 90 by now")
    tab.page.click("text=Reset")
    tab.page.wait_for_timeout(500)
    assert pixels(tab) == shown and "step=60" in tab.page.url
    tab.page.click("text=Show them")
    tab.until("Sample 0 of step 90")
    assert "step=90" in tab.page.url and tab.page.is_hidden(".newer")


def test_a_shape_is_turned_changed_picked_and_kept_in_the_address(tab: Tab) -> None:
    tab.go("explore?run=chairs")
    tab.drawn()
    first = pixels(tab)
    box = tab.page.locator(".stage canvas").bounding_box()
    tab.page.mouse.move(box["x"] + 100, box["y"] + 100)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + 220, box["y"] + 130, steps=4)
    tab.page.mouse.up()
    tab.page.wait_for_function("first => document.querySelector('.stage canvas').toDataURL() !== first", arg=first)
    tab.page.focus("input[type=range] >> nth=1")
    for _ in range(6):
        tab.page.keyboard.press("ArrowRight")
    tab.page.wait_for_function("() => location.hash.includes('slides=0.3')")
    tab.page.locator(".picks .cells button").nth(4).click()
    tab.page.click("text=Go towards another")
    tab.page.locator(".picks .cells button").nth(9).click()
    tab.page.wait_for_function("() => ['pick=4', 'other=9', 'mix=0.5'].every((part) => location.hash.includes(part))")
    tab.page.wait_for_function("() => location.hash.includes('azimuth=')")
    place = tab.page.url
    tab.page.reload()
    tab.drawn()
    assert tab.page.url == place and tab.page.locator("#mix input").input_value() == "0.5"


def test_keys_change_panels_samples_and_download(tab: Tab) -> None:
    tab.go("runs?run=chairs")
    tab.until("Samples over time")
    tab.page.keyboard.press("2")
    tab.drawn()
    tab.page.wait_for_selector(".export")
    tab.page.keyboard.press("n")
    tab.page.wait_for_function("() => location.hash.includes('pick=1')")
    with tab.page.expect_download() as told:
        tab.page.keyboard.press("e")
    assert told.value.suggested_filename == "chairs-01.glb"
    assert Path(told.value.path()).read_bytes()[:4] == b"glTF"
    tab.page.keyboard.press("?")
    tab.page.wait_for_selector("#keys")


def test_the_next_sample_may_be_asked_for_before_the_first_are_shown(tab: Tab) -> None:
    held: list[Any] = []
    tab.page.route("**/api/grid?*", lambda route: held.append(route))
    tab.go("explore?run=chairs")
    tab.drawn()
    tab.page.keyboard.press("n")
    tab.page.wait_for_function("() => location.hash.includes('pick=1')")
    tab.held(held)
    held[0].continue_()
    tab.page.wait_for_selector(".cells button[value='1'][aria-pressed=true]")
    assert len(held) == 1 and "page=0" in held[0].request.url


def test_a_full_queue_is_waited_for(tab: Tab) -> None:
    answers = [503, 503]

    def answer(route: Any) -> None:
        route.fulfill(status=answers.pop(), json={"error": "wait a moment"}) if answers else route.continue_()

    tab.page.route("**/api/grid?*", answer)
    tab.go("explore?run=chairs")
    tab.page.wait_for_selector(".cells button")
    assert not answers and tab.page.is_hidden("#trouble")


def test_a_material_is_lit_and_its_maps_are_downloaded(tab: Tab, tmp_path: Path) -> None:
    tab.go("materials?run=wood")
    tab.until("samples a pixel")
    tab.page.wait_for_selector(".maps figure:nth-child(4) img")
    tab.page.click("text=Plane, 2 × 2")
    tab.page.select_option("select[aria-label=light]", "directional")
    tab.until("light 45°")
    box = tab.page.locator(".rendering").bounding_box()
    tab.page.mouse.move(box["x"] + 90, box["y"] + 90)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + 150, box["y"] + 90, steps=3)
    tab.page.mouse.up()
    tab.page.wait_for_function("() => /around=-1[1-9]\\d/.test(location.hash)")
    with tab.page.expect_download() as told:
        tab.page.click("text=Download")
    assert told.value.suggested_filename == "wood-00.zip"


def dropped(tab: Tab, target: str, name: str, content: bytes) -> None:
    tab.page.evaluate(
        """([target, name, bytes]) => {
          const data = new DataTransfer();
          data.items.add(new File([new Uint8Array(bytes)], name));
          const at = target === "document" ? document : document.querySelector(target);
          at.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
        }""",
        [target, name, list(content)],
    )


def test_a_dropped_probe_lights_the_material(tab: Tab, tmp_path: Path) -> None:
    np.save(tmp_path / "sky.npy", np.ones((8, 16, 3), np.float32))
    tab.go("materials?run=wood")
    tab.until("samples a pixel")
    dropped(tab, "document", "sky.npy", (tmp_path / "sky.npy").read_bytes())
    tab.page.wait_for_function("() => location.hash.includes('light=dropped-')")


def test_what_was_changed_in_explore_is_lit_as_it_is(tab: Tab) -> None:
    tab.go("explore?run=wood&pick=2&slides=1,-0.5&truncation=0.8")
    tab.page.click("text=Light it")
    tab.until("samples a pixel")
    for path in ("/api/render?", "/api/maps?"):
        asked = [url for url in tab.asked if path in url]
        assert asked and all("slides=1%2C-0.5" in url and "truncation=0.8" in url and "pick=2" in url for url in asked)
    tab.page.wait_for_selector(".maps figure")
    tab.page.click("text=Change it in Explore")
    tab.page.wait_for_selector(".stage canvas")
    assert "slides=1%2C-0.5" in tab.page.url and "truncation=0.8" in tab.page.url


def test_maps_are_asked_for_once_at_a_time(tab: Tab) -> None:
    tab.go("materials?run=wood&pick=0&other=1&mix=0.1")
    tab.page.wait_for_selector(".picks .cells button")
    held: list[Any] = []
    tab.page.route("**/api/maps?*", lambda route: held.append(route))
    tab.page.focus("#mix input")
    for _ in range(8):
        tab.page.keyboard.press("ArrowRight")
    tab.held(held)
    tab.page.wait_for_timeout(500)
    assert len(held) == 1
    held[0].continue_()
    tab.held(held, 2)
    assert "mix=0.18" in held[1].request.url


def test_arrows_move_camera_and_light_as_a_hand_does(tab: Tab) -> None:
    """Up is the same for both: the camera goes below as in Explore, the light goes up; and there is no last turn."""
    tab.go("materials?run=wood&light=directional&view=40&around=-179&polar=45")
    tab.until("samples a pixel")
    tab.page.focus(".rendering")

    def reached(name: str, condition: str) -> None:
        number = f"Number(new URLSearchParams(location.hash.split('?')[1]).get('{name}'))"
        tab.page.wait_for_function(f"() => {{ const n = {number}; return {condition}; }}")

    def dragged_up() -> None:
        box = tab.page.locator(".rendering").bounding_box()
        tab.page.mouse.move(box["x"] + 90, box["y"] + 90)
        tab.page.mouse.down()
        tab.page.mouse.move(box["x"] + 90, box["y"] + 70, steps=3)
        tab.page.mouse.up()

    tab.page.keyboard.press("ArrowUp")
    reached("view", "n === 46")
    dragged_up()
    reached("view", "n > 46")
    tab.page.keyboard.press("Shift+ArrowUp")
    reached("polar", "n === 39")
    tab.page.keyboard.down("Shift")
    dragged_up()
    tab.page.keyboard.up("Shift")
    reached("polar", "n < 39")
    tab.page.keyboard.press("ArrowRight")
    reached("around", "n > 170")


@pytest.mark.parametrize("place, name", [("materials?run=wood", "probe.exr"), ("fit?run=chairs", "photo.png")])
def test_a_file_that_is_too_large_is_said_before_it_is_sent(tab: Tab, place: str, name: str) -> None:
    tab.go(place)
    tab.page.wait_for_selector(".zone, .maps figure")
    tab.page.evaluate(
        """(name) => {
          const data = new DataTransfer();
          data.items.add(new File([new Uint8Array(41e6)], name));
          document.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
        }""",
        name,
    )
    assert f"{name} is 41 MB; give at most 40 MB, " in tab.trouble()
    assert not [url for url in tab.asked if "/api/light" in url or "/api/fit?" in url]


def test_a_view_is_corrected_by_dragging(tab: Tab, folder: Path) -> None:
    tab.go("collections?run=chairs")
    tab.page.wait_for_selector(".pictures button")
    shown = tab.page.inner_text(".pictures button >> nth=0")
    labels = tab.page.locator(".views button > span:first-child").all_inner_texts()
    other = next(k for k, label in enumerate(labels, 1) if not shown.strip().startswith(f"{label} "))  # after "all"
    tab.page.drag_and_drop(".pictures button >> nth=0", f".views button >> nth={other}")
    tab.until("Saved.")
    assert (folder / "chairs" / "corrections.csv").read_text().startswith("file,azimuth")
    tab.until("1 corrected")
    with tab.page.expect_download() as told:
        tab.page.click("button:text-is('Download views.csv')")
    assert told.value.suggested_filename == "views.csv"


def test_pictures_without_views_have_none_to_choose(tab: Tab) -> None:
    none = {"views": "none", "labels": [], "counts": [], "correctable": False}
    tab.page.route("**/api/collection?*", lambda route: route.fulfill(json={**route.fetch().json(), **none}))
    tab.go("collections?run=chairs")
    tab.until("pictures, without views")
    tab.page.wait_for_selector(".pictures button:disabled")
    assert tab.page.is_hidden(".views") and tab.page.is_hidden("button:text-is('Download views.csv')")
    assert "undefined" not in tab.page.inner_text("#panel")


def test_what_was_opened_before_an_answer_came_stays_open(tab: Tab) -> None:
    held: list[Any] = []
    tab.page.route("**/api/kinds*", lambda route: held.append(route))
    tab.go("fit?run=chairs")
    tab.page.click("summary")
    tab.page.wait_for_selector(".check input")
    tab.held(held)
    assert len(held) == 1
    held[0].continue_()
    tab.page.wait_for_selector("[aria-label=search] option", state="attached")
    assert tab.page.is_visible(".check input")


def test_a_picture_is_dropped_explained_and_downloaded(tab: Tab, tmp_path: Path) -> None:
    picture = np.zeros((64, 64), np.uint8)
    picture[10:54, 20:44] = 255
    Image.fromarray(picture).save(tmp_path / "seat.png")
    tab.go("fit?run=chairs")
    tab.page.wait_for_selector(".zone")
    tab.page.click("summary")
    tab.page.uncheck("input[type=checkbox]")
    dropped(tab, "document", "seat.png", (tmp_path / "seat.png").read_bytes())
    tab.page.wait_for_function("() => /What was found|could not/.test(document.body.innerText)", timeout=2 * PATIENCE)
    assert not tab.page.is_visible("#trouble"), tab.page.text_content("#trouble")
    tab.until("Done in")
    found = [tab.page.get_attribute("img[alt=found]", "src"), tab.page.inner_text(".fitter section:last-child > p")]
    tab.page.locator(".fitter .cells button").nth(1).click()
    told = [tab.page.get_attribute("img[alt=found]", "src"), tab.page.inner_text(".fitter section:last-child > p")]
    assert all(before != after for before, after in zip(found, told, strict=True))  # its projection, and its distance
    with tab.page.expect_download() as told:
        tab.page.keyboard.press("e")
    assert told.value.suggested_filename == "seat-2.glb"
    assert Path(told.value.path()).read_bytes()[:4] == b"glTF"
    tab.page.reload()
    tab.until("What was found")
    fit, held = tab.page.url, []
    tab.page.route("**/api/fit?fit=*", lambda route: held.append(route))
    tab.page.evaluate("() => { Math.random = () => 0.5; }")  # some of its own pictures have empty explanations
    tab.page.click("text=Take one of its own pictures")
    tab.page.wait_for_function("before => location.href !== before", arg=fit)
    cleared = "() => !document.querySelector('.fitter').innerText.includes('seat.png')"
    tab.page.wait_for_function(cleared)  # nor "Done", before anything is known of the new one: answers are held
    tab.page.route("**/api/fit?fit=*", lambda route: route.continue_())
    while held:
        held.pop().continue_()
    tab.until("Done in")
    assert not tab.page.is_visible("#trouble"), tab.page.text_content("#trouble")


def test_a_fit_is_followed_on_after_an_answer_that_was_lost(tab: Tab, tmp_path: Path) -> None:
    lost = [True]

    def answer(route: Any) -> None:
        route.abort() if route.request.method == "GET" and lost and lost.pop() else route.continue_()

    picture = np.zeros((64, 64), np.uint8)
    picture[10:54, 20:44] = 255
    Image.fromarray(picture).save(tmp_path / "seat.png")
    tab.page.route("**/api/fit?*", answer)
    tab.go("fit?run=chairs")
    tab.page.wait_for_selector(".zone")
    tab.page.click("summary")
    tab.page.uncheck("input[type=checkbox]")
    dropped(tab, "document", "seat.png", (tmp_path / "seat.png").read_bytes())
    tab.until("Done in")
    assert not lost and not tab.page.is_visible("#trouble")


def test_that_a_file_holds_several_objects_is_said_in_the_page(tab: Tab, tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "two.npz", silhouettes=np.eye(64, dtype=np.float32)[None].repeat(2, 0))
    tab.go("fit?run=chairs")
    tab.page.wait_for_selector(".zone")
    tab.page.click("summary")
    tab.page.uncheck("input[type=checkbox]")
    assert tab.page.is_hidden("[aria-label=scale]")
    dropped(tab, "document", "two.npz", (tmp_path / "two.npz").read_bytes())
    tab.until("two.npz holds 2 objects, of which the first is explained.")


def test_a_file_that_no_panel_takes_is_refused(tab: Tab) -> None:
    tab.go("runs")
    tab.until("runs in")
    dropped(tab, "document", "seat.png", b"x")
    assert "takes no file" in tab.trouble()


def test_keys_work_while_a_slider_has_the_focus(tab: Tab) -> None:
    tab.go("explore?run=chairs&slides=1")
    tab.drawn()
    tab.page.wait_for_selector(".cells button")
    tab.page.focus(".slider:not([hidden]) input")
    tab.page.keyboard.press("r")
    tab.page.wait_for_function("() => !/slides=[^&]/.test(location.hash)")


BAD_PLACES = {
    "a run that is not there": ("explore?run=none", "there is no such run"),
    "a way out": ("runs?run=../../secret", "there is no such run"),
    "a broken run": ("runs?run=broken", "damaged"),
    "no number": ("explore?run=chairs&slides=9999", "give up to 8 numbers"),
    "a light that is gone": ("materials?run=wood&light=dropped-0", "there is no such light"),
    "a fit that is gone": ("fit?run=chairs&fit=none", "drop the picture again"),
}


@pytest.mark.parametrize("place, says", BAD_PLACES.values(), ids=list(BAD_PLACES))
def test_a_bad_address_is_said_and_the_page_goes_on(tab: Tab, place: str, says: str) -> None:
    tab.go(place)
    assert says in tab.trouble()
    tab.page.keyboard.press("1")
    tab.until("4 runs in")
    assert not tab.page.is_visible("#trouble")


LATE = {
    "the address": "app.keep({ run: 'wood', light: 'studio' });",
    "a request": "draws.forEach((draw) => draw('late'));",
}


@pytest.mark.parametrize("late", LATE.values(), ids=list(LATE))
def test_a_panel_that_is_left_changes_nothing_any_more(tab: Tab, late: str) -> None:
    tab.go("materials?run=wood")
    tab.until("samples a pixel")
    # A timer may fire after the address has changed and before the page is told so.
    tab.page.evaluate(
        f"""async () => {{
          const app = await import("/assets/app.js");
          window.drawn = [];
          const slow = app.latest(async (value) => {{
            await new Promise((done) => setTimeout(done, 50));
            window.drawn.push(value);
          }});
          slow("first");
          const draws = [slow];
          app.go("runs", {{}});
          {late}
        }}"""
    )
    tab.until("4 runs in")
    tab.page.wait_for_function("() => window.drawn.length")
    tab.page.wait_for_timeout(200)
    assert tab.page.evaluate("() => location.hash") == "#/runs"
    assert tab.page.evaluate("() => window.drawn") == ["first"]


def test_a_panel_says_that_it_does_not_show_what_a_run_makes(tab: Tab) -> None:
    tab.go("materials?run=chairs")
    tab.until("This run makes shapes, which this panel does not show.")
    tab.page.click("text=Explore its samples")
    tab.drawn()


BAD_FILES = {
    "no picture": ("x.png", b"no picture", "unreadable"),
    "a program": ("x.exe", b"MZ", "drop a picture"),
    "a bomb": ("x.png", None, "too large"),
    "a pickle": ("x.npz", b"\x80\x04", "x.npz"),
}


def bomb() -> bytes:
    """A picture of 40,000 × 40,000 pixels that announces them only."""
    import struct
    import zlib

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 40000, 40000, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


@pytest.mark.parametrize("name, content, says", BAD_FILES.values(), ids=list(BAD_FILES))
def test_a_bad_file_is_said_and_the_page_goes_on(tab: Tab, name: str, content: bytes | None, says: str) -> None:
    tab.go("fit?run=chairs")
    tab.page.wait_for_selector(".zone")
    dropped(tab, "document", name, bomb() if content is None else content)
    assert says in tab.trouble()
    tab.page.keyboard.press("2")
    tab.drawn()


@pytest.mark.parametrize(
    "place", ["runs", "runs?run=chairs", "explore?run=chairs", "materials?run=wood", "fit?run=chairs"]
)
@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(tab: Tab, place: str, width: int) -> None:
    tab.page.set_viewport_size({"width": width, "height": 720})
    tab.go(place)
    tab.page.wait_for_selector("#panel section, #panel article")
    tab.page.wait_for_load_state("networkidle")
    assert tab.page.evaluate("() => document.documentElement.scrollWidth") <= width


def test_on_a_telephone_sliders_are_below_the_sample_before_the_others(tab: Tab) -> None:
    tab.page.set_viewport_size({"width": 390, "height": 720})
    tab.go("explore?run=chairs")
    tab.drawn()
    tops = [tab.page.locator(name).first.bounding_box()["y"] for name in (".stage", ".controls", ".picks")]
    assert tops == sorted(tops)
