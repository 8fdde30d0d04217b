"""`dxb plan`: what a build would do."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Container, Sequence
from typing import TYPE_CHECKING

from dextera_build.build import fetch
from dextera_build.cli import options, table
from dextera_build.report.wording import count, duration

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.engine.graph import RuleFacts
    from dextera_build.workers.capacity import Capacity


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("target", metavar="RECIPE[:TARGET]")
    parser.add_argument(
        "--check", action="store_true", help="list only stale nodes and their causes; exit with 3 if there are any"
    )
    parser.add_argument(
        "--resources",
        metavar="NAME=AMOUNT,...",
        nargs="?",
        const="",
        help="resources of each node, and those that this machine, or one with these amounts, lacks: gpu=1,memory=16",
    )
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one node a line: address, status, rule, backend, seconds of the last time.

    `cached` is up to date, and so is `bare`, whose bytes are not in the store and are not needed; `stale` would run,
    `remote` would be fetched, `unknown` reads what one of these will return.
    With `--resources` there follow cores, memory that the rule declares, memory that was measured the last time, memory
    that the node is admitted by [GiB each], GPUs, GPU memory [GiB], named resources, and what this machine lacks of
    them.
    """
    from dextera_build.engine.dry import plan
    from dextera_build.engine.graph import parse_address
    from dextera_build.engine.lookup import copy_of
    from dextera_build.session import addresses

    session, target = options.session(args, args.target)
    graph = session.plan().graph
    wanted = addresses(graph, target)
    if args.check:
        from dextera_build.cli.build import stale

        return stale.check(session, graph, wanted, as_json=args.json)
    capacity = session.project.capacity(gpus=True) if args.resources is not None else None
    rows: list[dict[str, str]] = []
    nodes = plan(graph, wanted, session.store, history=session.past_builds)
    elsewhere = fetch.held(session, nodes)
    for node in nodes:
        rule = node.rule or copy_of(graph, parse_address(node.address).call, ()).rule
        row = {
            "node": node.address,
            "status": _status(node, elsewhere),
            "rule": rule.path,
            "backend": rule.backend or "-",
            "last_seconds": f"{node.seconds_last:.1f}" if node.seconds_last is not None else "-",
        }
        if capacity is not None:
            row |= _resources(rule, session.past_builds.peak_gb(node.address), capacity)
        rows.append(row)
    if not args.json:
        print(_sum([row["status"] for row in rows], nodes), file=sys.stderr)
    return table.give(rows, as_json=args.json)


def _sum(statuses: Sequence[str], nodes: Sequence[Planned]) -> str:
    """`12 of 41 nodes would run, 3 may follow, about 25 s`; the time is that of the last runs, one after another."""
    counts = Counter(statuses)
    if not counts["stale"] + counts["remote"] + counts["unknown"]:
        return f"{count(len(statuses), 'node')}, all up to date"
    told = [f"{counts['stale']} of {count(len(statuses), 'node')} would run"]
    told += [f"{counts['remote']} would be fetched"] if counts["remote"] else []
    told += [f"{counts['unknown']} may follow"] if counts["unknown"] else []
    stale = [node.seconds_last for node, status in zip(nodes, statuses, strict=True) if status == "stale"]
    known = [seconds for seconds in stale if seconds is not None]
    if known:
        told.append(f"about {duration(sum(known))}")
        told += [f"{len(stale) - len(known)} never ran here"] if len(known) < len(stale) else []
    return ", ".join(told)


def _status(node: Planned, elsewhere: Container[str]) -> str:
    if node.address in elsewhere:
        return "remote"
    return "bare" if node.bare and node.status == "cached" else node.status


def _resources(rule: RuleFacts, peak_gb: float | None, capacity: Capacity) -> dict[str, str]:
    from dextera_build.workers.admission import estimate

    lacking = rule.needs.lacks(capacity)
    return {
        "cpus": str(rule.cpus),
        "memory_declared": f"{rule.memory_gb:g}",
        "memory_measured": f"{peak_gb:.2f}" if peak_gb is not None else "-",
        "memory_admitted": f"{estimate(rule.needs, peak_gb).memory_gb:g}",
        "gpus": str(rule.gpus),
        "gpu_memory": f"{rule.gpu_gb:g}",
        "named": ",".join(f"{name}={amount:g}" for name, amount in rule.named) or "-",
        "lacks": ",".join(f"{name}={wanted - there:g}" for name, (wanted, there) in lacking.items()) or "-",
    }
