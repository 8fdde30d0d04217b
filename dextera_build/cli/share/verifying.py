"""`dxb cache verify`: read every blob and every result, and say what is damaged."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.report import wording

if TYPE_CHECKING:
    from dextera_build.gc.verify import Verdict


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("--repair", action="store_true", help="quarantine damaged blobs and drop results that lack one")
    parser.add_argument("--fast", action="store_true", help="compare sizes only, read no blob")


def run(args: argparse.Namespace) -> int:
    """Print one finding a line: kind, name, what is wrong, what was done; exit with 1 where damage stays."""
    from dextera_build.gc.verify import verify
    from dextera_build.session import reading

    shows = sys.stderr.isatty()
    verdict = verify(
        reading(options.project(args)), fast=args.fast, repair=args.repair, progress=_progress if shows else None
    )
    if shows:
        print("\r\x1b[K", end="", file=sys.stderr)
    cells = [
        {"kind": found.kind, "name": found.name, "detail": found.detail, "done": "repaired" if found.repaired else "-"}
        for found in verdict.findings
    ]
    table.give({**asdict(verdict), "whole": verdict.is_whole}, as_json=args.json, cells=cells)
    if not args.json:
        _sum_up(verdict, fast=args.fast)
    return 0 if verdict.is_whole else 1


def _progress(count: int, size: int) -> None:
    print(f"\r{count:,} blobs, {wording.size(size)}\x1b[K", end="", file=sys.stderr, flush=True)


def _sum_up(verdict: Verdict, *, fast: bool) -> None:
    looked = "looked at" if fast else "read"
    print(
        f"{looked} {verdict.blobs:,} blobs, {wording.size(verdict.bytes)}, {verdict.results:,} results", file=sys.stderr
    )
    if not verdict.is_whole:
        print("`dxb cache verify --repair` quarantines damaged files; builds make them again", file=sys.stderr)
