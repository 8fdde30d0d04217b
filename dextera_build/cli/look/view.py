"""`dxb view`: a scene, or one artifact, in the browser."""

from __future__ import annotations

import argparse
import json
import sys
import time
import webbrowser
from typing import TYPE_CHECKING, Any

from dextera_build.artifacts.identity import parse
from dextera_build.cli import options
from dextera_build.engine.graph import parse_address
from dextera_build.errors import DxbError, UsageError

if TYPE_CHECKING:
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("target", metavar="RECIPE[:NODE]", help="a recipe that was built, or one node of it")
    parser.add_argument("--port", type=int, default=8080, help="port to listen on (8080, or the next free one)")
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
    parser.add_argument("--no-open", action="store_true", help="do not open the browser")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until interrupted; the address goes to stdout."""
    from dextera_build.view import server

    session, node = options.session(args, args.target, last=True)
    fill = _one(session, node) if node else _scene(session)
    viewer, url = server.start(args.port, args.host, args.allow_origin)
    fill(viewer)
    print(json.dumps({"url": url}) if args.json else url, flush=True)
    print("press Ctrl-C to stop", file=sys.stderr)
    if not args.no_open:
        webbrowser.open(url)
    while True:
        try:
            time.sleep(3600)
        except KeyboardInterrupt:
            return 0


def _one(session: Session, node: str) -> Any:
    from dextera_build.view.show import show

    artifact = session.artifact(node)
    return lambda viewer: show(artifact, viewer, f"/{node}")


def _scene(session: Session) -> Any:
    """The parts of a scene from a recipe's last build, found by the types of the artifacts."""
    from dextera_build.view.scene import show_scene

    nodes = _by_type(session)
    missing = [kind for kind in ("Background", "Support", "Capture") if kind not in nodes]
    if missing:
        raise UsageError(
            f"`{session.recipe}` has no scene to show yet",
            code="DXB-U113",
            facts={"missing": ", ".join(missing)},
            hint=f"`dxb build {session.recipe}`, or name a node: `dxb view {session.recipe}:NODE`",
        )
    loaded: dict[str, Any] = {kind: session.artifact(nodes[kind][-1]) for kind in ("Background", "Support", "Capture")}
    addresses = {(parse_address(node).labels or (node,))[-1]: node for node in nodes.get("Asset", [])}
    assets: dict[str, Any] = {label: session.artifact(node) for label, node in addresses.items()}
    photograph = loaded["Capture"].photograph
    ground = loaded["Background"], loaded["Support"], photograph.camera
    return lambda viewer: show_scene(viewer, assets, *ground, photo=photograph.rgb, addresses=addresses)


def _by_type(session: Session) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for node in session.last_nodes:
        try:
            header = json.loads(session.store.blobs.get(session.output(node)))
        except DxbError:
            continue  # no longer in the store
        found.setdefault(parse(header["artifact"])[0], []).append(node)
    return found
