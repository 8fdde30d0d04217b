"""`dxb plan`: the effect of a build on every node, without running anything."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dextera_build.building import fetch
from dextera_build.cli import options, table
from dextera_build.cli.nodes import Row, planned, ranks, row
from dextera_build.engine import missing
from dextera_build.engine.dry import Planned
from dextera_build.engine.graph import parse_address
from dextera_build.report.wording import count, duration
from dextera_build.session import addresses

if TYPE_CHECKING:
    from dextera_build.engine.graph import Address, Plan, RuleFacts


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("target", metavar="RECIPE[:TARGET]", help="twin/laptop_scene, or one node of it")
    parser.add_argument(
        "--check", action="store_true", help="list only stale nodes and their causes; exit with 3 if there are any"
    )
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per node, in the order of a build: address, status, rule, backend, duration of the last run [s].

    `cached` is up to date, and so is `bare`, whose bytes are not in the store and are not needed; `stale` would run,
    `remote` would be fetched, `unknown` reads the output of one of these. `missing` needs a backend that this machine
    cannot run; what it lacks is printed, and the exit code is 4. If a required input is not given, every other node is
    `unknown`, and the exit code is 2.
    """
    session, target = options.session(args, args.target)
    plan = session.plan(incomplete=not args.check)
    graph = plan.graph
    wanted = addresses(graph, target)
    if plan.absent:
        return _incomplete(plan, wanted, as_json=args.json)
    if args.check:
        from dextera_build.cli.build import stale

        return stale.check("plan.check", session, graph, wanted, as_json=args.json)
    order = ranks(graph, wanted)
    nodes = sorted(planned(session, graph, wanted).values(), key=lambda node: order[parse_address(node.address).call])
    elsewhere = fetch.held(session, nodes)
    rows = [row(node, "remote" if node.address in elsewhere else "") for node in nodes]
    if not args.json:
        print(_sum([row["status"] for row in rows], nodes), file=sys.stderr)
    given = _give(rows, [node.rule for node in nodes], as_json=args.json)
    missing.refuse(node.rule for node, row in zip(nodes, rows, strict=True) if row["status"] == "missing")
    return given


def _give(rows: Sequence[Row], rules: Sequence[RuleFacts], *, as_json: bool) -> int:
    """Print the rows; in JSON with the missing requirements of the backend, and the next step."""
    full = [{**row, "needs": list(rule.missing), "next": rule.hint} for row, rule in zip(rows, rules, strict=True)]
    return table.give("plan", full, as_json=as_json, cells=rows)


def _incomplete(plan: Plan, wanted: Sequence[Address], *, as_json: bool) -> int:
    """The same without looking anything up: a required input is not given, so no key is known."""
    order = ranks(plan.graph, wanted)
    known = {path: call.rule for path, call in plan.graph.calls()}
    calls = [(path, known[path]) for path in order]
    rules = [rule for _, rule in calls]
    given = _give(
        [row(Planned(".".join(path), "unknown", None, None, rule)) for path, rule in calls], rules, as_json=as_json
    )
    missing.refuse_incomplete(plan.absent, rules)
    return given


def _sum(statuses: Sequence[str], nodes: Sequence[Planned]) -> str:
    """`12 of 41 nodes would run, 3 may follow, about 25 s`; the time is the sum of the last runs."""
    counts = Counter(statuses)
    if not counts["stale"] + counts["remote"] + counts["unknown"] + counts["missing"]:
        return f"{count(len(statuses), 'node')}, all up to date"
    told = [f"{counts['stale']} of {count(len(statuses), 'node')} would run"]
    told += [f"{counts['remote']} would be fetched"] if counts["remote"] else []
    told += [f"{counts['unknown']} may follow"] if counts["unknown"] else []
    told += [f"{counts['missing']} cannot run here"] if counts["missing"] else []
    stale = [node.seconds_last for node, status in zip(nodes, statuses, strict=True) if status == "stale"]
    known = [seconds for seconds in stale if seconds is not None]
    if known:
        told.append(f"about {duration(sum(known))}")
        told += [f"{len(stale) - len(known)} never ran here"] if len(known) < len(stale) else []
    return ", ".join(told)
