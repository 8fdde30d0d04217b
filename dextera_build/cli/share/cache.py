"""`dxb cache`: the store's size, whether it is whole, what can go, and other machines that use it."""

from __future__ import annotations

import argparse
import importlib

from dextera_build.cli import options, table

ACTIONS = {
    "push": ("upload results to a remote", "push"),
    "pull": ("download targets from a remote, without running anything", "pull"),
    "size": ("count blobs, results and unfinished calls, and their bytes", "cache"),
    "gc": ("delete unneeded results, down to a size or an age (shows a plan unless --yes)", "collecting"),
    "verify": ("read every file and report damage", "verifying"),
    "serve": ("serve the store to other machines, as a Bazel HTTP cache", "serving"),
}
"""Action -> (summary, module that carries it out)."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    actions = parser.add_subparsers(dest="what", metavar="ACTION", required=True)
    for name, (summary, module) in ACTIONS.items():
        sub = actions.add_parser(name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.")
        if module != "cache":
            importlib.import_module(f"dextera_build.cli.share.{module}").arguments(sub)
        options.project_arguments(sub)
        options.json_argument(sub)


def run(args: argparse.Namespace) -> int:
    """Carry the action out."""
    module = ACTIONS[args.what][1]
    if module != "cache":
        code: int = importlib.import_module(f"dextera_build.cli.share.{module}").run(args)
        return code
    return _count(args)


def _count(args: argparse.Namespace) -> int:
    """Print one kind a line: name, count, bytes."""
    from dextera_build.session import reading

    counted = reading(options.project(args)).size()
    rows = {kind: {"count": count, "bytes": total} for kind, (count, total) in counted.items()}
    cells = [{"kind": kind, "count": str(count), "bytes": str(total)} for kind, (count, total) in counted.items()]
    return table.give(rows, as_json=args.json, cells=cells)
