"""`dxb view`: a scene, a task, episodes, or one artifact, in the browser or in a file."""

from __future__ import annotations

import argparse
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options, table

if TYPE_CHECKING:
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    text = "a recipe that was built, a node of it, or fields of its result"
    parser.add_argument("target", metavar="RECIPE[:NODE]", help=text)
    parser.add_argument(
        "--port", type=options.port, default=8080, help="port to listen on (8080, or the next free one)"
    )
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS", help="address to listen on (127.0.0.1: this machine alone)"
    )
    parser.add_argument(
        "--allow-origin",
        action="append",
        default=[],
        metavar="ORIGIN",
        help="also admit pages of this origin: a notebook's proxy or a tunnel, https://hub.example.org",
    )
    parser.add_argument(
        "--save",
        metavar="FILE",
        help="write one file to share and stop: .html for any browser, .rrd for Rerun, or .viser",
    )
    parser.add_argument("--episode", metavar="INDEX", help="the episode to begin with")
    parser.add_argument("--no-open", action="store_true", help="do not open the browser")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until interrupted; the address goes to stdout, or the file's path."""
    from dextera_build.running import called
    from dextera_build.view import save

    session, node = options.session(args, args.target, last=True)
    if args.save:
        save.check(Path(args.save))
    with called.shown(session.project.library):
        return _served(args, session, node)


def _served(args: argparse.Namespace, session: Session, node: str) -> int:
    from dextera_build.building import part
    from dextera_build.cli.build.shown import warn
    from dextera_build.cli.look import shown
    from dextera_build.explain import stubs
    from dextera_build.session import notices
    from dextera_build.view import server

    fill = shown.of(session, node, args.episode)
    stub = stubs.told(session, part.named(session, node).node if node else "")
    if stub:
        notices[stub] = None
    warn()  # the viewer runs until it is stopped
    viewer, url = server.start(args.port, args.host, args.allow_origin)
    try:
        steps = fill(viewer)
        if stub:
            viewer.gui.add_markdown(f"**{stub}**")
        if args.save:
            return _save(args, session, node, viewer, steps)
        with suppress(KeyboardInterrupt):
            # Before the address: a program that reads it may stop the viewer at once.
            print("press Ctrl-C to stop", file=sys.stderr)
            table.say("view", {"url": url}, url, as_json=args.json)
            if not args.no_open:
                webbrowser.open(url)
            while True:
                time.sleep(3600)
        return 0
    finally:
        server.stop(viewer)


def _save(args: argparse.Namespace, session: Session, node: str, viewer: Any, steps: Iterator[float]) -> int:
    from dextera_build.cli.build.shown import warn
    from dextera_build.cli.look import eyes
    from dextera_build.view import save

    path = Path(args.save)
    seen = eyes.of(session, node, args.episode) if path.suffix == ".rrd" else []
    with table.writing(path, hint=None):
        save.write(viewer, path, steps, args.target, seen)
    warn()
    size = path.stat().st_size
    table.say("view.file", {"file": str(path), "bytes": size}, f"{path}  {size / 1e6:.1f} MB", as_json=args.json)
    return 0
