"""`dxb new twin`: a recipe for a photograph, or for a new photograph of a twin whose camera was moved."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from dextera_build.cli import options
from dextera_build.cli.project import written
from dextera_build.cli.project.init import twin_text
from dextera_build.cli.table import writing
from dextera_build.errors import UsageError
from dextera_build.project.planning import refuse_unknown

_AGAIN = """summary: {recipe} and a new photograph of its table, where the camera is now, and what moved.
extends: {recipe}
inputs:
  now:
    help: a folder with rgb.png, depth.png and capture.json, taken by the same camera.
nodes:
  new_photo: {{rule: capture.folder, folder: $now}}
  seen_again: {{recipe: twin/seen_again, photo: $photo, now: $new_photo, support: $ground, assets: $body.asset}}
targets:
  default: [seen_again.camera, seen_again.what]
"""
_NODES = ("photo", "ground", "body")
"""Nodes and inputs of a twin that the recipe reads."""
_NAME = re.compile(r"[a-z0-9_]+(/[a-z0-9_]+)+")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "--moved-camera",
        action="store_true",
        help="of a twin, its recipe: a recipe that says where the camera of a new photograph is, and what moved",
    )


def run(args: argparse.Namespace) -> int:
    """Write the recipe, print its path, and say what to do next."""
    if not args.name or not _NAME.fullmatch(args.name):
        raise UsageError(
            "a twin takes the name of a recipe" if not args.name else f"`{args.name}` is not a valid name",
            code="DXB-U192",
            hint="`dxb new twin twin/my_table`, or `dxb new twin twin/my_table --moved-camera` for a twin that exists",
        )
    project = options.project(args)
    name = f"{args.name}_again" if args.moved_camera else args.name
    place = project.root.absolute() / "recipes" / f"{name}.yaml"
    out = Path(args.out) if args.out else place
    if out.exists():
        raise UsageError(f"`{out}` exists already", code="DXB-U191", hint="`-o FILE` writes to another file")
    made, first = written.address(project, out, place)
    if args.moved_camera:
        refuse_unknown(project, args.name)
        recipe = project.recipe(args.name)
        known = {*recipe.nodes, *recipe.inputs} if recipe is not None else set()
        if missing := [each for each in _NODES if each not in known]:
            raise UsageError(
                f"`{args.name}` is no twin: it has no node `{missing[0]}`",
                code="DXB-U214",
                hint="name a recipe that extends twin/tabletop or twin/from_photo",
            )
        text, photograph, following = _AGAIN.format(recipe=args.name), "", "--input now=FOLDER"
    else:
        capture = f"captures/{args.name.rpartition('/')[2]}"
        text, following = twin_text(made, capture), ""
        photograph = f"put a photograph into `{capture}`: rgb.png, depth.png and capture.json; "
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text)
    print(project.shown(out.absolute()))
    for line in [] if first else written.hidden(project, made):
        print(f"  {line}", file=sys.stderr)
    print(f"  {photograph}{first}then: dxb build {made} {following}".rstrip(), file=sys.stderr)
    return 0
