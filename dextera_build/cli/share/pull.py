"""`dxb cache pull`: brings targets from a remote, and runs nothing."""

from __future__ import annotations

import argparse
import shlex
import sys
from typing import TYPE_CHECKING

from dextera_build.build import fetch
from dextera_build.cli import options, table
from dextera_build.errors import StoreError, listing

if TYPE_CHECKING:
    from dextera_build.build.build import Built
    from dextera_build.runs.events import Event
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "targets", nargs="+", metavar="RECIPE[:TARGET]", help="targets to download, with the nodes that they depend on"
    )
    parser.add_argument(
        "--from",
        metavar="NAME|URL",
        dest="source",
        help="the remote; default: all remotes of the settings that may be read",
    )
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Place results as `build` does; one line each: address, main file."""
    from dextera_build.cli.build.shown import shown

    project = options.project(args)
    lacking: list[str] = []
    rows: list[dict[str, str]] = []
    for text in args.targets:
        session, target = options.session(args, text, project, makes=True)
        built = _bring(session, target, args)
        lacking += [f"{session.recipe}:{place}" for place in built.result.errors]
        rows += [{"node": node, "file": shown(path)} for node, path in built.placed.paths.items()]
    table.give(rows, as_json=args.json)
    if lacking:
        count = "1 node is" if len(lacking) == 1 else f"{len(lacking)} nodes are"
        raise StoreError(
            f"{count} neither in the store nor in a remote",
            code="DXB-S202",
            facts={"lacking": listing(lacking, most=40)},
            hint=f"`{shlex.join(['dxb', 'build', *args.targets, *options.again(args)])}` builds the missing results",
        )
    return 0


def _bring(session: Session, target: str, args: argparse.Namespace) -> Built:
    from dextera_build.build.build import Order, build
    from dextera_build.build.lock import Locking
    from dextera_build.cli.build.shown import tell

    order = Order([target], keep_going=True, argv=sys.argv[1:], bring_from=fetch.exchange(session, "r", args.source))
    built = build(
        session, order, Locking(session.project, lock=False, locked=False, added=session.added), _Shown(session.recipe)
    )
    tell(built)
    return built


class _Shown:
    """One line for what came, and one for the whole."""

    def __init__(self, recipe: str) -> None:
        from dextera_build.cli.consoles.lines import Columns

        self._columns, self._recipe = Columns(), recipe

    def __call__(self, event: Event) -> None:
        from dextera_build.cli.consoles import lines
        from dextera_build.runs import events

        line = None
        if isinstance(event, events.RunFinished):
            line = lines.pulled(self._recipe, event)
        elif isinstance(event, events.RemoteGivenUp) or getattr(event, "status", "") == "fetched":
            line = self._columns.line(event, verbose=False)
        if line is not None:
            print(lines.plain(line), file=sys.stderr, flush=True)
