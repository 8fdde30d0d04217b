"""`dxb cache pull`: download targets from a remote without running anything."""

from __future__ import annotations

import argparse
import shlex
import sys

from dextera_build.building import fetch
from dextera_build.building.build import Order, build
from dextera_build.building.lock import Locking
from dextera_build.cli import options, table
from dextera_build.cli.build.shown import shown, tell
from dextera_build.cli.consoles import lines
from dextera_build.errors import StoreError, listing
from dextera_build.runs.events import Event, Listener, RemoteGivenUp, RunFinished


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
    """Download targets and place them as `build` does; print one line each: address, main file."""
    project = options.project(args)
    lacking: list[str] = []
    rows: list[dict[str, str]] = []
    for text in args.targets:
        session, target = options.session(args, text, project, makes=True)
        remotes = fetch.exchange(session, "r", args.source)
        order = Order([target], keep_going=True, argv=sys.argv[1:], bring_from=remotes)
        locking = Locking(project, lock=False, locked=False, added=session.added)
        built = build(session, order, locking, _show(session.recipe))
        tell(built)
        lacking += [f"{session.recipe}:{place}" for place in built.result.errors]
        rows += [{"node": node, "file": shown(path)} for node, path in built.placed.paths.items()]
    table.give("cache.pull", rows, as_json=args.json)
    if lacking:
        count = "1 node is" if len(lacking) == 1 else f"{len(lacking)} nodes are"
        raise StoreError(
            f"{count} neither in the store nor in a remote",
            code="DXB-S202",
            facts={"lacking": listing(lacking, most=40)},
            hint=f"`{shlex.join(['dxb', 'build', *args.targets, *options.again(args)])}` builds the missing results",
        )
    return 0


def _show(recipe: str) -> Listener:
    """Print one line per fetched node, and a summary."""

    def show(event: Event) -> None:
        line = None
        if isinstance(event, RunFinished):
            line = lines.pulled(recipe, event)
        elif isinstance(event, RemoteGivenUp) or getattr(event, "status", "") == "fetched":
            line = lines.line(event, verbose=False)
        if line is not None:
            print(lines.plain(line), file=sys.stderr, flush=True)

    return show
