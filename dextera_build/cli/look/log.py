"""`dxb log`: the nodes of a run, and their output."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options, table
from dextera_build.errors import UsageError, did_you_mean, listing

if TYPE_CHECKING:
    from dextera_build.project.project import Project


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("run", nargs="?", metavar="RUN|RECIPE", help="a run's id, or a recipe for its last run")
    parser.add_argument("node", nargs="?", metavar="NODE", help="print everything that this node printed")
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per node, or one node's log."""
    from dextera_build.explain import runs

    project = options.project(args)
    run, events = runs.find(project, args.run)
    finished = {event["node"]: event for event in events if event["event"] == "node_finished"}
    if args.node is None:
        cells = [
            {"node": node, "status": event["status"], "time": f"{event['seconds']:.1f} s", "line": _line(event)}
            for node, event in finished.items()
        ]
        code = table.give("log", events, as_json=args.json, cells=cells)
        _tell_costs(events)
        return code
    if args.node not in finished:
        raise UsageError(
            f"run {run} has no node `{args.node}`",
            code="DXB-U110",
            facts={"nodes": listing(finished, most=40)},
            hint=did_you_mean(args.node, finished),
        )
    logged = (event["text"] for event in events if event["event"] == "node_log" and event["node"] == args.node)
    text = _printed(project, finished[args.node]) or "\n".join(logged)
    if args.json:
        told = {"run": run, "node": args.node, "status": finished[args.node]["status"], "text": text or None}
        return table.give("log.node", told, as_json=True)
    if text or finished[args.node].get("error"):
        print(text or _line(finished[args.node]))
    else:
        print("no output: the node printed nothing, or the store no longer holds its log", file=sys.stderr)
    return 0


def _line(finished: Mapping[str, Any]) -> str:
    """Summary of a node's result, or its error."""
    error = finished.get("error")
    return f"{error.get('code', '')}: {error.get('message', '')}".partition("\n")[0] if error else finished["line"]


def _tell_costs(events: Iterable[Mapping[str, Any]]) -> None:
    """Print the cost of the calls of a run on standard error, if there is any."""
    from dextera_build.runs.costs import Costs

    costs = Costs()
    for event in events:
        if event["event"] == "node_paid":
            costs.add(event["service"], event["usd"], sure=event["sure"])
    if str(costs):
        print(f"cost: {costs}", file=sys.stderr)


def _printed(project: Project, finished: Mapping[str, Any]) -> str:
    """Everything that a node printed when it ran, in this run or an earlier one; "" if the store does not have it.

    It includes direct output of the rule and the traceback of a failure, which are not in any event.
    """
    from dextera_build.session import reading

    store = reading(project)
    found = store.actions.known(finished["key"]) if finished["key"] else None
    log = finished.get("log") or (found.log if found else None)
    return store.blobs.get(log).decode(errors="replace").rstrip() if log and store.blobs.has(log) else ""
