"""`dxb get`: a node's artifact, or a part of it, as files or as one file in the format of its suffix."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from dextera_build.cli import options, table
from dextera_build.errors import UsageError


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "node", metavar="RECIPE:NODE", help="a node, or fields of its result: twin/laptop_scene:body[mug].mesh.mesh"
    )
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
    from dextera_build.building import one_file, part
    from dextera_build.explain import stubs

    session, node = options.session(args, args.node, last=True)
    if not node:
        hint = f"`dxb get {session.recipe}:NODE`; `dxb ls {session.recipe}`"
        raise UsageError("a node is missing: `get` takes RECIPE:NODE", code="DXB-U111", hint=hint)
    wanted = part.named(session, node)
    artifact = part.artifact(session, wanted)
    if told := stubs.told(session, wanted.node):
        print(told, file=sys.stderr)
    out = Path(args.out)
    as_file = bool(out.suffix) and not (args.out.endswith(os.sep) or out.is_dir())
    with table.writing(out):
        written = one_file.write(artifact, out, _tell) if as_file else artifact.export(out, wanted.stem)
    files = [str(path) for path in written]
    table.say("get", {"files": files}, "\n".join(files), as_json=args.json)
    return 0


def _tell(line: str) -> None:
    print(line, file=sys.stderr)
