"""How the gallery finds its pictures: each that an example has written to its folder runs/ is moved to the page."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst


class Written:
    """A scraper of sphinx-gallery: takes the PNG and GIF files that the block of code has written."""

    def __call__(self, block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
        found = sorted(path for kind in ("png", "gif") for path in Path("runs").glob(f"*.{kind}"))
        moved = [self.move(path, block_vars["image_path_iterator"]) for path in found]
        return figure_rst(moved, gallery_conf["src_dir"])

    def move(self, path: Path, targets: Any) -> str:
        target = Path(next(targets)).with_suffix(path.suffix)
        shutil.move(path, target)
        return str(target)

    def __repr__(self) -> str:
        return "Written()"  # sphinx-gallery keeps the configuration: the same each time, so that pages stay
