"""`dxb cache`: the store's size."""

from __future__ import annotations

import argparse
import json

from dextera_build.cli import options


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("what", choices=("size",), help="size: how many blobs and results, how many bytes")
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one kind a line: name, count, bytes."""
    from dextera_build.store.store import Store

    size = Store(options.project(args).cache).size()
    if args.json:
        print(json.dumps({kind: {"count": count, "bytes": total} for kind, (count, total) in size.items()}))
    else:
        for kind, (count, total) in size.items():
            print(f"{kind}\t{count}\t{total}")
    return 0
