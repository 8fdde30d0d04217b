"""`dxb cache`: size, verification and garbage collection of the store, and exchange with other machines."""

from __future__ import annotations

import argparse
import importlib
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.cli.share import amounts
from dextera_build.report import wording

if TYPE_CHECKING:
    from dextera_build.gc.collect import Collection

_ACTIONS = {
    "push": "upload results to a remote",
    "pull": "download targets from a remote, without running anything",
    "size": "count blobs, results and unfinished calls, and their bytes",
    "gc": "delete unneeded results, down to a size or an age (shows a plan unless --yes)",
    "verify": "read every file and report damage",
    "serve": "serve the store to other machines, as a Bazel HTTP cache",
}
_MODULES = {action: f"dextera_build.cli.share.{action}" for action in ("push", "pull", "serve")}
"""Actions in separate modules."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    actions = parser.add_subparsers(dest="what", metavar="ACTION", required=True)
    subs = {}
    for name, text in _ACTIONS.items():
        subs[name] = actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        if name in _MODULES:
            importlib.import_module(_MODULES[name]).arguments(subs[name])
    collect, verify = subs["gc"], subs["verify"]
    collect.add_argument(
        "--max-size", metavar="SIZE", help="delete the least recently used results above this size: 50GB"
    )
    collect.add_argument("--max-age", metavar="AGE", help="delete results that were not used for this long: 30d")
    collect.add_argument("--yes", action="store_true", help="delete; without it, only show the plan")
    verify.add_argument("--repair", action="store_true", help="quarantine damaged blobs and drop results that lack one")
    verify.add_argument("--fast", action="store_true", help="compare sizes only, read no blob")
    for sub in subs.values():
        options.project_arguments(sub)
        options.json_argument(sub)


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    if args.what in _MODULES:
        code: int = importlib.import_module(_MODULES[args.what]).run(args)
        return code
    return {"size": _size, "gc": _collect, "verify": _verify}[args.what](args)


def _size(args: argparse.Namespace) -> int:
    """Print one line per kind: name, count, bytes."""
    from dextera_build.session import reading

    counted = reading(options.project(args)).size()
    rows = [{"kind": kind, "count": count, "bytes": total} for kind, (count, total) in counted.items()]
    return table.give("cache.size", rows, as_json=args.json)


def _collect(args: argparse.Namespace) -> int:
    """Print one line per kind and reason: `drop` or `keep`, the kind, count, bytes, why."""
    limit = round(amounts.read(args.max_size, "size")) if args.max_size is not None else None
    age_s = amounts.read(args.max_age, "time") if args.max_age is not None else None

    from dextera_build.cli.consoles.lines import printable
    from dextera_build.gc.collect import collect_all
    from dextera_build.session import reading

    said = collect_all(reading(options.project(args)), size=limit, age_s=age_s, dry=not args.yes)
    cells = [
        # A reason names folders, read from files that others can edit.
        {"do": do, "kind": row.kind, "count": str(row.count), "bytes": str(row.bytes), "why": printable(row.why)}
        for do, rows in (("drop", said.gone), ("keep", said.stays))
        for row in rows
    ]
    table.give("cache.gc", {**asdict(said), "dry": not args.yes}, as_json=args.json, cells=cells)
    if not args.json:
        _explain(said, limit, dry=not args.yes)
    return 0


def _explain(said: Collection, limit: int | None, *, dry: bool) -> None:
    told = [f"`{workspace}` no longer exists: its results are not kept" for workspace in said.vanished]
    if said.running:
        told.append("results that running builds may need are kept")
    before, after = wording.size(said.before), wording.size(said.after)
    if not said.gone:
        told.append(f"nothing {'would be' if dry else 'was'} deleted: the store has {after}")
    elif dry:
        told.append(f"the store would shrink from {before} to {after}; nothing was deleted: add `--yes`")
    else:
        told.append(f"the store shrank from {before} to {after}")
    if limit is not None and said.after > limit:
        told.append(f"that is above {wording.size(limit)}: the lines `keep` give the reasons")
    print("\n".join(told), file=sys.stderr)


def _verify(args: argparse.Namespace) -> int:
    """Print one line per finding: kind, name, damage, repair; return 1 if damage remains."""
    from dextera_build.gc.verify import verify
    from dextera_build.session import reading

    moves = sys.stderr.isatty()
    store = reading(options.project(args))
    verdict = verify(store, fast=args.fast, repair=args.repair, progress=_progress if moves else None)
    if moves:
        print("\r\x1b[K", end="", file=sys.stderr)
    cells = [
        {"kind": found.kind, "name": found.name, "detail": found.detail, "done": "repaired" if found.repaired else "-"}
        for found in verdict.findings
    ]
    table.give("cache.verify", {**asdict(verdict), "whole": verdict.is_whole}, as_json=args.json, cells=cells)
    if not args.json:
        looked = "checked the sizes of" if args.fast else "read"
        blobs = f"{wording.count(verdict.blobs, 'blob')}, {wording.size(verdict.bytes)}"
        print(f"{looked} {blobs}, and {wording.count(verdict.results, 'result')}", file=sys.stderr)
        if not verdict.is_whole:
            print("`dxb cache verify --repair` quarantines damaged files; builds make them again", file=sys.stderr)
    return 0 if verdict.is_whole else 1


def _progress(count: int, size: int) -> None:
    print(f"\r{count:,} blobs, {wording.size(size)}\x1b[K", end="", file=sys.stderr, flush=True)
