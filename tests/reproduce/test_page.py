"""docs/reproduction.md and the figures' pages say what the results that are kept beside them say."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent


def test_the_pages_are_those_that_the_tool_writes(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("reproduction_page", ROOT / "tools" / "reproduction_page.py")
    assert spec is not None and spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    tool.write_pages(tmp_path)
    written = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.md"))
    assert len(written) >= 10
    for path in written:
        stored = (ROOT / "docs" / path).read_text(encoding="utf-8")
        assert stored == (tmp_path / path).read_text(encoding="utf-8"), f"{path}: run tools/reproduction_page.py"
        for link in re.findall(r"\]\((\S+)\)", stored):
            assert (ROOT / "docs" / path).parent.joinpath(link).exists(), f"{path}: {link}"


def test_the_documents_are_small() -> None:
    built = {"_build", "api", "gallery"}  # by `make docs`, not kept
    files = [path for path in (ROOT / "docs").rglob("*") if path.is_file() and not built & set(path.parts)]
    assert not [path for path in files if path.suffix in (".png", ".jpg")], "save figures as .webp"
    assert sum(path.stat().st_size for path in files if path.suffix != ".html") < 10e6
