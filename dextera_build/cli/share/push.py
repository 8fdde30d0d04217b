"""`dxb cache push`: upload results to a remote."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

from dextera_build.building import fetch
from dextera_build.cli import options, table
from dextera_build.cli.consoles import lines
from dextera_build.engine.dry import plan
from dextera_build.errors import StoreError, listing
from dextera_build.report.wording import count
from dextera_build.runs.events import Uploaded, Uploading
from dextera_build.session import addresses

if TYPE_CHECKING:
    from dextera_build.remotes.exchange import Exchange

_TICK_S = 0.2
_SAY_S = 5.0


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "targets", nargs="+", metavar="RECIPE[:TARGET]", help="targets to upload, with the nodes that they depend on"
    )
    parser.add_argument(
        "--to", metavar="NAME|URL", help="the remote; default: all remotes of the settings that may be written"
    )
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per uploaded node: address, key."""
    project, exchange = options.project(args), None
    sent, stale, bare = dict[str, str](), list[str](), dict[str, str]()
    for text in args.targets:
        session, target = options.session(args, text, project)
        graph = session.plan().graph
        exchange = exchange or fetch.exchange(session, "w", args.to)
        for node in plan(graph, addresses(graph, target), session.store):
            address = f"{session.recipe}:{node.address}"
            if node.status != "cached" or node.key is None:
                stale.append(address)
            elif node.bare:
                bare[address] = node.key
            else:
                exchange.offer(node.key)
                sent[address] = node.key
    assert exchange is not None
    bare = {address: key for address, key in bare.items() if not exchange.holds(key)}
    left = _finish_uploads(exchange)
    rows = [{"node": address, "key": key} for address, key in sent.items() if key not in left]
    table.give("cache.push", rows, as_json=args.json)
    if stale or bare:
        lacking = {"not built": listing(stale)} if stale else {}
        lacking |= {"without bytes here": listing(bare)} if bare else {}
        raise StoreError(
            f"not uploaded: {count(len(stale) + len(bare), 'node')}",
            code="DXB-S201",
            facts=lacking,
            hint=f"dxb build {'--whole ' if bare else ''}{' '.join(args.targets)}",
        )
    return 1 if left else 0


def _finish_uploads(exchange: Exchange) -> set[str]:
    """Wait for uploads, report them, and return the keys of failed uploads."""
    said = time.monotonic()
    while left := exchange.wait(_TICK_S):
        if time.monotonic() - said > _SAY_S:
            said = time.monotonic()
            progress = Uploading(time.time(), exchange.offered - left, exchange.offered)
            print(lines.plain(lines.uploading(progress)), file=sys.stderr, flush=True)
    uploads = exchange.close()
    for sent in uploads:
        told = Uploaded(time.time(), sent.remote, sent.results, sent.octets, len(sent.left), sent.reason)
        print("".join(f"{lines.plain(line).strip()}\n" for line in lines.uploaded(told)), end="", file=sys.stderr)
    return {key for sent in uploads for key in sent.left}
