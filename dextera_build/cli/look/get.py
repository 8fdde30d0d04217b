"""`dxb get`: a node's artifact as files, or as one file in the format of its suffix."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from dextera_build.cli import options
from dextera_build.cli.table import writing
from dextera_build.errors import UsageError


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("node", metavar="RECIPE:NODE", help="twin/laptop_scene:body[mug].mesh")
    parser.add_argument(
        "-o",
        "--out",
        metavar="DIR|FILE",
        default=".",
        help="the folder to write to (the current one), or a file whose suffix chooses its format: mug.glb",
    )
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Write the files and print their paths, the main one first."""
    from dextera_build.building import one_file
    from dextera_build.building.export import stem_of
    from dextera_build.explain import stubs

    session, node = options.session(args, args.node, last=True)
    if not node:
        hint = f"`dxb get {session.recipe}:NODE`; `dxb ls {session.recipe}`"
        raise UsageError("a node is missing: `get` takes RECIPE:NODE", code="DXB-U111", hint=hint)
    artifact = session.artifact(node)
    if told := stubs.told(session, node):
        print(told, file=sys.stderr)
    out = Path(args.out)
    as_file = bool(out.suffix) and not (args.out.endswith(os.sep) or out.is_dir())
    with writing(out):
        written = one_file.write(artifact, out) if as_file else artifact.export(out, stem_of(node))
    print(json.dumps({"files": [str(path) for path in written]}) if args.json else "\n".join(map(str, written)))
    return 0
