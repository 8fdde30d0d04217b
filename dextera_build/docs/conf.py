"""Sphinx settings of the docs pages: MyST, furo, and references that are generated from the code."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent.parent)]

import dextera_build  # noqa: E402  (after the checkout is on the path)

project = "dxb"
author = "the dxb authors"
copyright = "the dxb authors, Apache-2.0"
release = dextera_build.__version__
version = release

extensions = ["myst_parser", "dxb_reference"]
exclude_patterns = ["_ext", "_build"]
myst_enable_extensions = ["attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
suppress_warnings: list[str] = []

html_theme = "furo"
html_title = f"dxb {release}"
html_static_path = ["_static"]
html_css_files = ["dxb.css"]
html_copy_source = False
html_show_sourcelink = False
pygments_style = "friendly"
pygments_dark_style = "monokai"
