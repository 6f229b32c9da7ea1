"""The documentation site. `make docs` builds it into docs/_build/html; sources are the pages as GitHub shows them.

The source folder is the repository, so that links such as ../README.md lead to the same page there and here.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import pictures
import reference
from sphinx.application import Sphinx

import unproject

project = "unproject"
author = "the unproject authors"
release = unproject.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_gallery.gen_gallery"]

root_doc = "docs/index"
include_patterns = ["*.md", "docs/**.md", "docs/api/*.rst", "docs/gallery/*.rst"]
exclude_patterns = ["**/.*", ".*", "runs", "demo", "build", "dist", "src", "tests", "docs/_build", "examples"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}

html_theme = "furo"
html_title = "unproject"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["_static/index.html"]  # leads from the site's root to docs/index.html
html_copy_source = False
html_use_index = False
html_domain_indices = False
html_show_sphinx = False
html_show_copyright = False
templates_path: list[str] = []

myst_heading_anchors = 4
myst_enable_extensions = ["attrs_block"]

default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = [("Class attributes", "params_style")]
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!unproject\.).*"),  # other packages' names: their sites are not asked while this one is built
]

sphinx_gallery_conf = {
    "examples_dirs": "examples/gallery",
    "gallery_dirs": "docs/gallery",
    "filename_pattern": r"\.py$",
    "image_scrapers": (pictures.Written(),),
    "reset_modules": (),
    "capture_repr": (),
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "write_computation_times": False,
    "within_subsection_order": "FileNameSortKey",
    "copyfile_regex": r"^$",
}
linkcheck_anchors = False


def setup(app: Sphinx) -> None:
    app.connect("builder-inited", reference.write, priority=100)
    app.connect("autodoc-process-docstring", reference.escape, priority=100)
    app.connect("missing-reference", reference.resolve)
