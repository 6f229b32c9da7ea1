"""The studio in a browser: seconds to the first picture, milliseconds to a mesh and to a rendering, random clicking.

    python benchmarks/studio.py RUNS --minutes 15

RUNS has a run of shapes called chairs and one of a material called wood; it is copied, to 50 runs, elsewhere. Chromium
and Playwright are needed (docs/studio.md). Before the random clicking every panel of every run is opened, every control
of PLACES used once and a picture explained by each search, since what is opened is kept: memory that grows afterwards
is a leak. Prints one JSON object:

    first_picture_s     from the start of the page to the first picture of 50 runs
    mesh_ms             from a slider's move to the mesh on the canvas: median, and 95th of 100
    rendering_ms        of 256 × 256 pixels, from the drag to the picture: median, and 95th of 100
    clicks, errors, requests_elsewhere    of random clicking
    opened_s, opened_mb    of opening everything once, and what the server and the page's objects take then
    memory_mb, page_mb    of the server, and of the page's objects on its first panel: medians of each tenth of the time
"""

from __future__ import annotations

import argparse
import json
import random
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from playwright.sync_api import CDPSession, Error, Page, sync_playwright

FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]
SEARCHES = ("quick", "thorough")
RUNS, MOVES, CONTROLS = 50, 100, 60
PANELS = ("runs", "explore", "materials", "collections", "fit")
PLACES = (
    "runs",
    "runs?run=chairs",
    "runs?run=chairs&other=wood",
    "explore?run=chairs",
    "materials?run=wood",
    "collections?run=chairs",
    "fit?run=chairs",
)


def many(source: Path, folder: Path) -> None:
    """Make 50 runs: those of the source, and copies of them without their checkpoints."""
    names = [path.name for path in source.iterdir() if (path / "recipe.json").is_file()]
    for name in names:
        shutil.copytree(source / name, folder / name)
    for k in range(RUNS - len(names)):
        name = names[k % len(names)]
        shutil.copytree(source / name, folder / f"{name}-{k}", ignore=shutil.ignore_patterns("checkpoints"))


def started(folder: Path) -> tuple[subprocess.Popen[str], str]:
    words = [sys.executable, "-m", "unproject", "studio", str(folder), "--port", "0"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    found = re.search(r"http://\S+", process.stdout.readline())
    assert found is not None
    return process, found[0]


def memory_mb(process: subprocess.Popen[str]) -> float:
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024  # pyright: ignore[reportOptionalSubscript]


def heap_mb(devtools: CDPSession) -> float:
    """Return what the page's objects take, once what nothing refers to is gone."""
    devtools.send("HeapProfiler.collectGarbage")
    return devtools.send("Runtime.getHeapUsage")["usedSize"] / 2**20


def first_picture(page: Page, address: str) -> float:
    began = time.perf_counter()
    page.goto(f"{address}#/runs")
    page.wait_for_function("() => [...document.images].some((image) => image.complete && image.naturalWidth)")
    return time.perf_counter() - began


def milliseconds(page: Page, address: str, place: str, move: str) -> dict[str, float]:
    """Move something again and again, each time after what came before is drawn; the page says how long it took."""
    page.goto(f"{address}#/{place}")
    note = (
        "() => { const told = / (\\d+) ms/.exec(document.querySelector('#panel').innerText); return told && told[1]; }"
    )
    page.wait_for_function(note, timeout=120_000)
    time.sleep(2)
    taken = []
    for k in range(MOVES):
        taken.append(page.evaluate(move, k))
    return {"median": statistics.median(taken), "p95": sorted(taken)[int(0.95 * MOVES)]}


SLIDE = """(k) => new Promise((done) => {
  const note = document.querySelector('.explorer section p.small');
  const slider = document.querySelectorAll('.controls .slider input')[1];
  const began = performance.now();
  const seen = new MutationObserver(() => { seen.disconnect(); done(performance.now() - began); });
  seen.observe(note, { childList: true, characterData: true, subtree: true });
  slider.value = -2 + (k * 0.37) % 4;
  slider.dispatchEvent(new Event('input'));
})"""
DRAG = """(k) => new Promise((done) => {
  const image = document.querySelector('.rendering'), began = performance.now();
  image.addEventListener('load', () => setTimeout(() => done(performance.now() - began), 0), { once: true });
  image.dispatchEvent(new KeyboardEvent('keydown', { key: k % 2 ? 'ArrowLeft' : 'ArrowRight', bubbles: true }));
})"""
CLICK = """(seed) => {
  const kinds = 'a, button, select, input, canvas, .rendering';
  const shown = [...document.querySelectorAll(kinds)].filter((one) => one.offsetParent && !one.disabled);
  const one = shown[Math.floor(seed * shown.length)];
  if (!one || one.type === 'file') return;
  if (one.type === 'range') {
    one.value = Number(one.min) + Math.random() * (one.max - one.min);
    one.dispatchEvent(new Event('input'));
  } else if (one.tagName === 'SELECT') {
    one.selectedIndex = Math.floor(Math.random() * one.options.length);
    one.dispatchEvent(new Event('change'));
  } else one.click();
}"""


EXPLAIN = """(search) => {
  document.querySelector('select[aria-label=search]').value = search;
  [...document.querySelectorAll('button')].find((one) => one.textContent === 'Take one of its own pictures').click();
}"""


def explained(page: Page, address: str, search: str) -> None:
    """Let one of the pictures of training be explained, to the end."""
    page.goto(f"{address}#/runs")
    page.wait_for_timeout(500)
    page.goto(f"{address}#/fit?run=chairs")
    page.wait_for_function("() => document.querySelectorAll('select[aria-label=search] option').length > 0")
    page.evaluate(EXPLAIN, search)
    page.wait_for_function("() => document.body.innerText.includes('Done in')")


def opened(page: Page, address: str, process: subprocess.Popen[str], names: list[str]) -> dict[str, Any]:
    """Open every panel of every run, use every control of PLACES once, and explain a picture by each search."""
    began = time.perf_counter()
    for place in [f"{panel}?run={name}" for name in names for panel in PANELS]:
        page.goto(f"{address}#/{place}")
        page.wait_for_timeout(500)
    for place in PLACES:
        for k in range(CONTROLS):
            page.goto(f"{address}#/{place}")
            page.wait_for_timeout(150)
            with suppress(Error):  # it went to another page
                page.evaluate(CLICK, (k + 0.5) / CONTROLS)
    for search in SEARCHES:
        explained(page, address, search)
    devtools = page.context.new_cdp_session(page)
    return {
        "opened_s": round(time.perf_counter() - began),
        "opened_mb": [round(memory_mb(process)), round(at_first_panel(page, address, devtools), 2)],
    }


def at_first_panel(page: Page, address: str, devtools: CDPSession) -> float:
    """Return what the page's objects take on its first panel, where memory is always looked at: panels differ."""
    page.goto(f"{address}#/runs")
    page.wait_for_function("() => !!document.querySelector('article')")  # a handle would keep the whole list
    return heap_mb(devtools)


def clicked(page: Page, address: str, process: subprocess.Popen[str], minutes: float) -> dict[str, Any]:
    """Click at random; now and then go to another panel."""
    draw, asked, wrong = random.Random(0), [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "response",
        lambda response: wrong.append(response.url) if response.status >= 500 and response.status != 503 else None,
    )
    began, clicks, memory = time.perf_counter(), 0, []
    devtools = page.context.new_cdp_session(page)
    while time.perf_counter() - began < 60 * minutes:
        if clicks % 25 == 0:
            heap = at_first_panel(page, address, devtools)
            memory.append((memory_mb(process), heap))
            page.goto(f"{address}#/{draw.choice(PLACES)}")
        try:
            page.evaluate(CLICK, draw.random())
        except Error as error:  # it went to another page meanwhile
            if "context was destroyed" not in str(error):
                wrong.append(str(error))
        page.wait_for_timeout(150)
        clicks += 1
    elsewhere = [url for url in asked if not url.startswith((address, "data:", "blob:"))]
    tenths = [memory[k * len(memory) // 10 : (k + 1) * len(memory) // 10] or memory[-1:] for k in range(10)]
    levels = [tuple(map(statistics.median, zip(*tenth, strict=True))) for tenth in tenths]
    return {
        "minutes": minutes,
        "clicks": clicks,
        "errors": wrong,
        "requests_elsewhere": elsewhere,
        "memory_mb": [round(server) for server, _ in levels],
        "page_mb": [round(heap, 2) for _, heap in levels],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--minutes", type=float, default=15)
    given = parser.parse_args()
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        many(given.runs, Path(name))
        browser = playwright.chromium.launch(executable_path=browser_path, args=FLAGS)
        process, address = started(Path(name))
        try:
            page = browser.new_page(viewport={"width": 1280, "height": 720})
            page.context.request.get(address)  # brings the cookie
            address = address.partition("?")[0]
            page.set_default_timeout(120_000)  # a busy machine is no fault of the page
            found: dict[str, Any] = {"first_picture_s": round(first_picture(page, address), 3)}
            found["mesh_ms"] = milliseconds(page, address, "explore?run=chairs", SLIDE)
            found["rendering_ms"] = milliseconds(page, address, "materials?run=wood", DRAG)
            print(json.dumps(found), flush=True)
            found |= opened(page, address, process, sorted(run.name for run in Path(name).iterdir()))
            print(json.dumps(found), flush=True)
            found |= clicked(page, address, process, given.minutes)
            print(json.dumps(found))
        finally:
            process.terminate()


if __name__ == "__main__":
    main()
