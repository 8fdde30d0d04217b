"""`dxb cache`: the store's size, and what can go."""

from __future__ import annotations

import argparse
import json

from dextera_build.cli import options


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "what",
        choices=("size", "sweep"),
        help="size: how many blobs, results and unfinished calls, how many bytes; "
        "sweep: drop the progress that calls saved which did not end, and that nobody builds now",
    )
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one kind a line: name, count, bytes; for `sweep` what was dropped."""
    from dextera_build.store.store import Store

    store = Store(options.project(args).cache)
    counted = store.size() if args.what == "size" else {"keep": store.keep.sweep(store.locks)}
    if args.json:
        print(json.dumps({kind: {"count": count, "bytes": total} for kind, (count, total) in counted.items()}))
    else:
        for kind, (count, total) in counted.items():
            print(f"{kind}\t{count}\t{total}")
    return 0
