"""`dxb cache gc`: collect what nobody needs; without `--yes` it only says what that is."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.cli.share import amounts
from dextera_build.report import wording

if TYPE_CHECKING:
    from dextera_build.gc.collect import Collection


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "--max-size", metavar="SIZE", help="delete the least recently used results above this size: 50GB"
    )
    parser.add_argument("--max-age", metavar="AGE", help="delete results that were not used for this long: 30d")
    parser.add_argument("--yes", action="store_true", help="delete; without it, only show the plan")


def run(args: argparse.Namespace) -> int:
    """Print one line per kind and reason: `drop` or `keep`, the kind, count, bytes, why."""
    limit = amounts.size(args.max_size) if args.max_size is not None else None
    age_s = amounts.seconds(args.max_age) if args.max_age is not None else None

    from dextera_build.cli.consoles.lines import printable
    from dextera_build.gc.collect import collect_all
    from dextera_build.session import reading

    said = collect_all(reading(options.project(args)), size=limit, age_s=age_s, dry=not args.yes)
    cells = [
        # A reason names folders, by files that somebody may have changed.
        {"do": do, "kind": row.kind, "count": str(row.count), "bytes": str(row.bytes), "why": printable(row.why)}
        for do, rows in (("drop", said.gone), ("keep", said.stays))
        for row in rows
    ]
    table.give({**asdict(said), "dry": not args.yes}, as_json=args.json, cells=cells)
    if not args.json:
        _explain(said, limit, dry=not args.yes)
    return 0


def _explain(said: Collection, limit: int | None, *, dry: bool) -> None:
    for workspace in said.vanished:
        print(f"`{workspace}` no longer exists: its results are not kept", file=sys.stderr)
    if said.running:
        print("results that running builds may need are kept", file=sys.stderr)
    before, after = wording.size(said.before), wording.size(said.after)
    if said.gone:
        print(f"the store {'would shrink' if dry else 'shrank'} from {before} to {after}", file=sys.stderr)
    else:
        print(f"nothing {'would be' if dry else 'was'} deleted: the store has {after}", file=sys.stderr)
    if limit is not None and said.after > limit:
        print(f"that is above {wording.size(limit)}: the rest is held, see the lines `keep`", file=sys.stderr)
    if dry and said.gone:
        print("nothing was dropped; add `--yes`", file=sys.stderr)
