"""`dxb cache serve`: serve the store to other machines over HTTP."""

from __future__ import annotations

import argparse
import sys

from dextera_build.cli import options
from dextera_build.errors import MachineError


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (127.0.0.1: this machine alone)")
    parser.add_argument("--port", type=int, default=8098, help="0 takes any that is free (8098)")
    parser.add_argument("--read-only", action="store_true", help="give what is there, and take nothing")
    parser.add_argument("--most", type=float, default=16.0, metavar="GB", help="largest blob that is taken [GB] (16)")
    parser.add_argument("-v", "--verbose", action="store_true", help="one line for each request")


def run(args: argparse.Namespace) -> int:
    """Print the server's address, and serve until interrupted."""
    from dextera_build.store.remotes.server import CacheServer
    from dextera_build.store.store import Store

    store = Store(options.project(args).cache)
    log = sys.stderr if args.verbose else None
    try:
        server = CacheServer(
            store, (args.host, args.port), read_only=args.read_only, most_bytes=int(args.most * 1e9), log=log
        )
    except (OSError, OverflowError) as error:
        raise MachineError(
            f"nothing can listen at {args.host}:{args.port}",
            code="DXB-E331",
            facts={"system says": getattr(error, "strerror", None) or error},
            hint="dxb cache serve --port 0",
        ) from None
    with server:
        print(server.url, flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print(f"served {server.given:,} and took {server.taken:,} blobs and results", file=sys.stderr)
    return 0
