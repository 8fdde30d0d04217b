"""`dxb cache serve`: serve the store to other machines over HTTP."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.cli.share import amounts
from dextera_build.errors import MachineError, UsageError

if TYPE_CHECKING:
    from dextera_build.project.project import Project

SECRET = "DXB_SERVE_SECRET"
_MAKE_ONE = (
    "openssl req -x509 -newkey ed25519 -nodes -days 365 -subj /CN=HOST -addext subjectAltName=DNS:HOST "
    "-keyout cert.pem -out cert.pem"
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help=f"address to listen at (127.0.0.1: this machine alone); any other needs `{SECRET}` or --read-only",
    )
    parser.add_argument("--port", type=int, default=8098, help="port to listen on; 0: any free one (8098)")
    parser.add_argument("--read-only", action="store_true", help="refuse uploads")
    parser.add_argument("--most", default="16GB", metavar="SIZE", help="largest blob that is accepted (16GB)")
    parser.add_argument(
        "--tls", metavar="FILE", help="serve HTTPS with this certificate and private key (one PEM file)"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="log one line per request")


def run(args: argparse.Namespace) -> int:
    """Print the server's address, and serve until interrupted."""
    import ssl

    from dextera_build.remotes.server import CacheServer
    from dextera_build.store.store import Store

    project = options.project(args)
    most, secret = round(amounts.read(args.most, "size")), os.environ.get(SECRET, "")
    _refuse_open_doors(args, project, secret)
    store = Store(project.cache)
    try:
        server = CacheServer(
            store,
            (args.host, args.port),
            read_only=args.read_only,
            most_bytes=most,
            log=sys.stderr if args.verbose else None,
            secret=secret,
            tls=args.tls or "",
        )
    except ssl.SSLError as error:
        raise UsageError(
            f"`{args.tls}` does not hold a certificate with its private key",
            code="DXB-U146",
            facts={"reason": error.reason or error},
            hint=_MAKE_ONE,
        ) from None
    except (OSError, OverflowError) as error:
        raise MachineError(
            f"cannot listen on {args.host}:{args.port}",
            code="DXB-E331",
            facts={"system says": getattr(error, "strerror", None) or error},
            hint="dxb cache serve --port 0",
        ) from None
    with server:
        table.say("cache.serve", {"url": server.url}, server.url, as_json=args.json)
        with suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0


def _refuse_open_doors(args: argparse.Namespace, project: Project, secret: str) -> None:
    """Refuse a server that anyone could write to, because its clients trust the results.

    Raises:
        UsageError: Anyone could write, or unsigned results could enter a store that requires signatures.
    """
    from dextera_build.remotes.remote import is_loopback

    if args.tls and not os.path.isfile(args.tls):
        raise UsageError(f"there is no file `{args.tls}`", code="DXB-U146", hint=_MAKE_ONE)
    if args.read_only:
        return
    if project.require_signed:
        raise UsageError(
            "`require_signed` is set, and uploads of clients are not signed",
            code="DXB-U138",
            facts={"from": project.config["require_signed"].origin},
            hint="dxb cache serve --read-only",
        )
    if is_loopback(args.host):
        return
    if not secret:
        raise UsageError(
            f"anyone who can reach `{args.host}` could write to the store",
            code="DXB-U139",
            facts={"clients then use": "`https://dxb:SECRET@HOST:PORT`"},
            hint=f"`export {SECRET}=$(openssl rand -hex 16)`, or `--read-only`",
        )
    if not args.tls:
        print(
            f"warning: without `--tls` the secret of `{SECRET}` would cross the network in the clear, and clients of "
            "dxb refuse to send it",
            file=sys.stderr,
        )
