"""`dxb view`: a scene in the browser."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

from dextera_build.cli import options
from dextera_build.errors import MachineError, UsageError
from dextera_build.loader import version_of

if TYPE_CHECKING:
    from dextera_build.cli.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("target", metavar="RECIPE[:NODE]", help="a recipe that was built, or one node of it")
    parser.add_argument("--port", type=int, default=8080, help="port on localhost (8080)")
    parser.add_argument("--no-open", action="store_true", help="do not open the browser")
    options.project_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until interrupted; the address goes to stdout."""
    if version_of("viser") is None:
        raise MachineError("the viewer is not installed", code="DXB-E303", hint="`pip install 'dextera-build[view]'`")
    from dextera_build.cli.session import Session, wish
    from dextera_build.view import server

    wanted = wish(args.target)
    session = Session(options.project(args), wanted.recipe)
    nodes = _nodes(session, wanted.target)
    artifacts = {node: session.artifact(node) for node in nodes}
    viewer, url = server.start(args.port)
    server.show_all(viewer, artifacts)
    print(url, flush=True)
    print("Ctrl-C ends it", file=sys.stderr)
    if not args.no_open:
        server.open_browser(url)
    try:
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        return 0


def _nodes(session: Session, target: str) -> list[str]:
    from dextera_build.view.show import SHOWN_RULES

    if target:
        return [target]
    found = [node for node in session.history if session.document(node)["rule"] in SHOWN_RULES]
    if not found:
        raise UsageError(
            f"nothing of `{session.recipe}` can be shown yet", code="DXB-U113", hint=f"`dxb build {session.recipe}`"
        )
    return found
