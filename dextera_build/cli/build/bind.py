"""`dxb bind`: which object each name is, by a phrase, a property or a point in the photograph."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys

from dextera_build.cli import options, table
from dextera_build.errors import UsageError


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("target", metavar="RECIPE[:NODE]", help="a recipe whose objects get names, or the node")
    parser.add_argument("name", metavar="NAME", nargs="?", default="", help="the name; without it, every bound name")
    parser.add_argument("--at", metavar="COLUMN,ROW", help="a pixel of the object in the photograph")
    parser.add_argument("--phrase", metavar="WORDS", help="words of its phrase and properties: 'blue mug'")
    parser.add_argument("--category", metavar="WORD", help="its category: mug")
    parser.add_argument("--material", metavar="WORD", help="its material: ceramic")
    parser.add_argument("--colour", metavar="WORD", help="its colour: blue")
    parser.add_argument("--remove", metavar="NAME", help="remove a name from dxb.lock")
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Write names to `dxb.lock`, and print every object: name, proposed name, a point, source of the binding."""
    from dextera_build.building import bind
    from dextera_build.cli.consoles import console
    from dextera_build.recipe.bindings import PROPERTIES, Binding

    properties = {key: value for key in PROPERTIES if (value := getattr(args, key))}
    draft = Binding(_point(args.at), properties=properties) if args.at or properties else None
    if (draft and not args.name) or (args.remove and args.name):
        raise UsageError(
            "`--remove` takes the name, `--at` and properties follow it",
            code="DXB-U212",
            hint="`dxb bind TARGET NAME --at COLUMN,ROW`, or `dxb bind TARGET --remove NAME`",
        )
    project = options.project(args)
    if args.remove:
        bind.remove(project, args.target, args.remove)
        if args.json:
            table.give("bind.removed", {"target": args.target, "removed": args.remove}, as_json=True)
        return 0
    naming = bind.Naming(project, args.target)
    with console(project.console, sys.stderr, verbose=False) as shown:
        prepared = naming.prepare(shown)
    if not prepared.ok:
        return 1
    found = naming.bind(args.name, draft)
    for name in found.stale:
        hint = f"`dxb bind {naming.address} {name} --at COLUMN,ROW`"
        print(f"warning: `{name}` is bound by a point on another photograph; {hint}", file=sys.stderr)
    cells = [
        {
            "name": row.name,
            "object": row.object,
            "at_px": f"{row.at_px[0]},{row.at_px[1]}",
            "bound_by": row.bound or "-",
        }
        for row in found.rows
    ]
    rows = [dataclasses.asdict(row) | {"bound": row.bound or None} for row in found.rows]
    content = {"node": naming.address, "objects": rows, "stale": found.stale}
    return table.give("bind", content, as_json=args.json, cells=cells)


def _point(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    if not (parts := re.fullmatch(r"\s*([0-9]{1,6})\s*,\s*([0-9]{1,6})\s*", text)):
        raise UsageError(
            f"`{text}` is not a point", code="DXB-U213", hint="`--at COLUMN,ROW`, in pixels: `--at 412,233`"
        )
    return int(parts[1]), int(parts[2])
