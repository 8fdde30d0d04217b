"""`dxb init`: a new project that builds at once."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from pathlib import Path

from dextera_build.cli.table import writing
from dextera_build.errors import UsageError

_CONFIG = """# Settings of this project; `dxb show --config` prints each value with its origin.
profile = "cpu"
cache = "cache"
"""
_IGNORE = "cache/\n.envs/\ndxb.local.toml\n__pycache__/\n"
_RECIPE = """summary: The twin of {words}.
extends: twin/tabletop
# The photograph: `{capture}/` of this project, with rgb.png, depth.png and capture.json. `dxb build {name}` and
# `dxb build --lock {name}` need no more; `--input capture=PATH` takes another one.
inputs:
  capture: {capture}
# Options of one object's nodes, by the object's name in the build log:
#   dxb build {name} --input capture=PATH --set 'body[blue_mug].mesh.primitives.wall_m=0.004'
"""
_README = """# A dxb project

    dxb build twin/{name}     # of capture/, a folder with rgb.png, depth.png, capture.json
    dxb report{dots}          # the report, one HTML file
    dxb view twin/{name}      # the scene in the browser

`recipes/` holds recipes, `rules/` (optional) your own rules: see `dxb new --help`.
"""
_NEXT = """
put a photograph into `{capture}`: rgb.png, depth.png and capture.json; then
  {cd}dxb build twin/{name}
"""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("folder", nargs="?", default=".", help="the project's folder (created if missing)")


def run(args: argparse.Namespace) -> int:
    """Write the project's files, and say what to do next; existing files are left unchanged."""
    root = Path(args.folder)
    name = _name(root)
    files = {
        "dxb.toml": _CONFIG,
        ".gitignore": _IGNORE,
        "README.md": _README.format(name=name, dots=" " * len(name)),
        f"recipes/twin/{name}.yaml": twin_text(f"twin/{name}", "capture"),
    }
    if (root / "dxb.toml").exists():
        raise UsageError(
            f"`{root / 'dxb.toml'}` exists: this folder is a project already",
            code="DXB-U190",
            hint="`dxb ls` shows its recipes",
        )
    for file, text in files.items():
        path = root / file
        if path.exists():
            continue
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        print(path)
    cd = "" if root.resolve() == Path.cwd() else f"cd {shlex.quote(str(root))} && "
    print(_NEXT.format(capture=root / "capture", cd=cd, name=name), end="", file=sys.stderr)
    return 0


def twin_text(recipe: str, capture: str) -> str:
    """A recipe of this address for the photograph in a folder of the project."""
    return _RECIPE.format(name=recipe, words=recipe.rpartition("/")[2].replace("_", " "), capture=capture)


def _name(root: Path) -> str:
    """The name of the folder as that of a recipe; `my_table` for one without letters."""
    return re.sub(r"[^a-z0-9]+", "_", root.resolve().name.lower()).strip("_") or "my_table"
