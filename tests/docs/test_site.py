"""The site: built without warnings, every link leads somewhere, nothing comes from elsewhere, everything is on it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import unproject

ROOT = Path(__file__).parents[2]
IMAGES = sorted((ROOT / "docs" / "images").iterdir())
SOURCES = ("*.md", "docs", "examples")


class Page(HTMLParser):
    """The links of a page, what it loads, and what can be linked to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.shown: list[str] = []
        """Links but for those of the navigation that are folded below another page."""
        self.item = ""
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors.update(given[name] for name in ("id", "name") if name in given)
        if tag == "li":
            self.item = given.get("class", "")
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
            if not re.search("toctree-l[23]", self.item):
                self.shown.append(given["href"])
        elif tag == "link" and given.get("rel") not in ("next", "prev", "index", "search"):
            self.loads.append(given["href"])
        elif "src" in given:
            self.loads.append(given["src"])


Pages = dict[Path, Page]


def build(folder: Path) -> Path:
    """Build the site from a copy, so that nothing is written beside the pages."""
    listed = ["git", "ls-files", "-co", "--exclude-standard", "--", *SOURCES]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    for name in (name for name in names if (ROOT / name).is_file()):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, folder / name)
    # Of a hundred thousand nodes that all stay, a third of the time would go into looking for garbage.
    code = "import gc, sys; gc.disable(); from sphinx.cmd.build import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "-q", "-W", "--keep-going", "-n", "-c", "docs", ".", "html"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "html"


@pytest.mark.slow
def test_the_site(tmp_path: Path, forked: None) -> None:
    """One test, so that the site is built once, whichever worker has it."""
    pytest.importorskip("sphinx", reason="Sphinx is not installed: pip install 'unproject[docs]'")
    site = build(tmp_path.resolve())
    pages = {path: Page(path) for path in site.rglob("*.html") if "_static" not in path.parts}
    every_link_and_anchor_exists(site, pages)
    links_that_lead_nowhere_are_found(site, pages)
    pages_load_nothing_from_elsewhere(site, pages)
    every_public_name_is_in_the_reference(site, pages)
    every_example_of_the_gallery_has_its_pictures(site, pages)
    every_page_can_be_reached_from_the_first(site, pages)
    clicks_are_as_told(site, pages)
    assert "url=docs/index.html" in (site / "index.html").read_text() and (site / "docs" / "index.html").is_file()


def missing(page: Path, link: str, pages: Pages) -> bool:
    """Whether a link within the site leads nowhere."""
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return False
    target = (page.parent / unquote(parts.path)).resolve() if parts.path else page.resolve()
    if not target.is_file():
        return True
    known = pages.get(target)
    return bool(parts.fragment and known and unquote(parts.fragment) not in known.anchors)


def every_link_and_anchor_exists(site: Path, pages: Pages) -> None:
    wrong = {(p.name, link) for p, found in pages.items() for link in found.links if missing(p, link, pages)}
    assert len(pages) > 40 and not wrong


def links_that_lead_nowhere_are_found(site: Path, pages: Pages) -> None:
    first = site / "docs" / "index.html"
    assert missing(first, "nothing.html", pages) and missing(first, "usage.html#nothing", pages)
    assert not missing(first, "usage.html#the-verdict", pages)


def pages_load_nothing_from_elsewhere(site: Path, pages: Pages) -> None:
    loaded = {(path.name, source) for path, page in pages.items() for source in page.loads}
    assert loaded and not {(name, source) for name, source in loaded if re.match(r"(https?:)?//", source)}
    styles = {style: style.read_text(encoding="utf-8") for style in site.rglob("*.css")}
    assert styles
    elsewhere = re.compile(r"(url\(|@import)\s*['\"]?(https?:)?//")
    assert not [style.name for style, text in styles.items() if elsewhere.search(text)]
    assert not [path.name for path, page in pages.items() for s in page.loads if missing(path, s, pages)]


def every_public_name_is_in_the_reference(site: Path, pages: Pages) -> None:
    anchors = set().union(*(page.anchors for path, page in pages.items() if path.parent.name == "api"))
    modules = {f"module-unproject.{name}" for name in unproject._SUBMODULES}
    names = {f"unproject.{name}" for name in unproject._HOME}
    assert modules <= anchors and names <= anchors
    own = {f"unproject.ops.{name}" for name in unproject.ops.__all__}
    assert own <= anchors


def every_example_of_the_gallery_has_its_pictures(site: Path, pages: Pages) -> None:
    scripts = sorted((ROOT / "examples" / "gallery").glob("*.py"))
    assert scripts
    for script in scripts:
        page = pages[site / "docs" / "gallery" / f"{script.stem}.html"]
        written = re.findall(r"runs/[\w-]+\.(?:png|gif)", script.read_text(encoding="utf-8"))
        assert len([source for source in page.loads if script.stem in source]) == len(written) >= 1, script.name


def clicks(first: Path, pages: Pages) -> dict[Path, int]:
    """How many links it takes from the first page to every page and file."""
    known = {path.resolve(): page for path, page in pages.items()}
    found, new = {first.resolve(): 0}, {first.resolve()}
    while new:
        linked = {(p.parent / urlsplit(link).path).resolve() for p in new for link in known[p].shown} - set(found)
        found |= dict.fromkeys(linked, max(found.values()) + 1)
        new = linked & set(known)
    return found


def every_page_can_be_reached_from_the_first(site: Path, pages: Pages) -> None:
    found = clicks(site / "docs" / "index.html", pages)
    assert {p.name for p in pages if p.resolve() not in found} == {"index.html", "search.html"}  # the root's, a form's


def clicks_are_as_told(site: Path, pages: Pages) -> None:
    """The column of this site in docs/compared.md: to a page, or to what a page links to."""
    text = (ROOT / "docs" / "compared.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| [^|]+ \| \[(\d)\]\(([^)]+)\) \|", text, re.MULTILINE)
    found = clicks(site / "docs" / "index.html", pages)
    downloads = {path.name: path for path in found if path.suffix in (".sh", ".yaml")}
    for count, link in told:
        page = (site / "docs" / link).resolve()
        assert found[downloads.get(page.name, page.with_suffix(".html"))] == int(count), link
    assert len(told) == 15


@pytest.mark.parametrize("picture", IMAGES, ids=lambda path: path.name)
def test_a_picture_is_small_and_its_command_is_told(picture: Path) -> None:
    assert picture.suffix == ".webp" and picture.stat().st_size < 100_000
    assert f"(images/{picture.name})" in (ROOT / "docs" / "pictures.md").read_text(encoding="utf-8")


def test_pictures_are_small_together() -> None:
    assert sum(picture.stat().st_size for picture in IMAGES) < 600_000
