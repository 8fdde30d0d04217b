"""`dxb init`: a new project that builds at once."""

from __future__ import annotations

import argparse
from pathlib import Path

from dextera_build.errors import UsageError

_CONFIG = """# Settings of this project; `dxb show --config` prints each value with its origin.
profile = "cpu"
cache = "cache"
"""
_IGNORE = "cache/\n.envs/\ndxb.local.toml\n__pycache__/\n"
_RECIPE = """summary: The twin of my table.
extends: twin/tabletop
# Options of one object's nodes, by the object's name in the build log:
#   dxb build twin/my_table --input capture=PATH --set 'body[blue_mug].mesh.primitives.wall_m=0.004'
"""
_README = """# A dxb project

    dxb build twin/my_table --input capture=PATH     # a folder with rgb.png, depth.png, capture.json
    dxb report                                       # the report, one HTML file
    dxb view twin/my_table                           # the scene in the browser

`recipes/` holds recipes, `rules/` (optional) your own rules: see `dxb new --help`.
"""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("folder", nargs="?", default=".", help="the project's folder (created if missing)")


def run(args: argparse.Namespace) -> int:
    """Write the project's files; existing files are left unchanged."""
    root = Path(args.folder)
    files = {
        "dxb.toml": _CONFIG,
        ".gitignore": _IGNORE,
        "README.md": _README,
        "recipes/twin/my_table.yaml": _RECIPE,
    }
    if (root / "dxb.toml").exists():
        raise UsageError(
            f"`{root / 'dxb.toml'}` exists: this folder is a project already",
            code="DXB-U190",
            hint="`dxb ls` shows its recipes",
        )
    for name, text in files.items():
        path = root / name
        if path.exists():
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        print(path)
    return 0
