"""`dxb diff`: what is different between two runs, two nodes or two artifacts."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.errors import UsageError

if TYPE_CHECKING:
    from dextera_build.explain.compare import Row

_MOST = 40
"""Lines for one node; `--json` has all."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "old",
        metavar="A",
        help="a run (0141), a node (twin/a:scene), a node of a run (0141:scene), or the beginning of the digest of a "
        "key or an output; a single recipe or node: its last two runs",
    )
    parser.add_argument("new", metavar="B", nargs="?", help="the other operand")
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one difference a line: [node,] kind, name, change; nothing where all is equal."""
    from dextera_build.cli.look import diff_operands
    from dextera_build.explain import compare
    from dextera_build.session import reading

    project = options.project(args)
    store = reading(project)
    old, new = diff_operands.pair(project, store, args.old, args.new)
    if isinstance(old, compare.Side) and isinstance(new, compare.Side):
        return _print({"": compare.rows(store, old, new)}, (old.name, new.name), as_json=args.json)
    if isinstance(old, compare.Side) or isinstance(new, compare.Side):
        raise UsageError(
            "a run and a result cannot be compared",
            code="DXB-U164",
            hint="name two runs, or two results: `dxb diff 0141:NODE 0142:NODE`",
        )
    return _print(compare.run_rows(store, old.events, new.events), (old.name, new.name), as_json=args.json)


def _print(found: Mapping[str, Sequence[Row]], names: tuple[str, str], *, as_json: bool) -> int:
    plain = [{"node": node, "rows": [row.to_json() for row in rows]} for node, rows in found.items() if rows]
    cells = [
        ({"node": node} if node else {}) | {"kind": row.kind, "name": row.name, "change": row.change}
        for node, rows in found.items()
        for row in rows[:_MOST]
    ]
    table.give({"old": names[0], "new": names[1], "differences": plain}, as_json=as_json, cells=cells)
    if as_json:
        return 0
    for node, rows in found.items():
        if len(rows) > _MOST:
            print(f"{node}: {len(rows) - _MOST} more, `--json` has all".removeprefix(": "), file=sys.stderr)
    if not any(found.values()):
        print(f"{names[0]} and {names[1]} are equal", file=sys.stderr)
    return 0
