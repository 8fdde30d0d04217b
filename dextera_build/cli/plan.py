"""`dxb plan`: what a build would do."""

from __future__ import annotations

import argparse
import json

from dextera_build.cli import options, remotes


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("target", metavar="RECIPE[:TARGET]")
    parser.add_argument(
        "--check", action="store_true", help="only what is stale and why; exit with 3 where that is anything"
    )
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one node a line: address, status, rule, backend, seconds of the last time.

    `cached` is up to date, `stale` would run, `remote` would be fetched, `unknown` reads what one of these will return.
    """
    from dextera_build.cli.session import Session, addresses
    from dextera_build.engine.dryrun import plan
    from dextera_build.engine.graph import parse_address

    project = options.project(args)
    wanted = options.wish(args.target)
    session = Session(project, wanted.recipe)
    graph = session.plan(options.request(args, project.profile)).graph
    if args.check:
        from dextera_build.cli import stale

        return stale.check(session, graph, addresses(graph, wanted.target), as_json=args.json)
    calls = dict(graph.calls())
    rows = []
    nodes = plan(graph, addresses(graph, wanted.target), session.store, history=session.past_builds)
    elsewhere = remotes.held(session, nodes)
    for node in nodes:
        rule = calls[parse_address(node.address).call].rule
        rows.append(
            {
                "node": node.address,
                "status": "remote" if node.address in elsewhere else node.status,
                "rule": rule.path,
                "backend": rule.backend or "-",
                "last_seconds": f"{node.seconds_last:.1f}" if node.seconds_last is not None else "-",
            }
        )
    print(json.dumps(rows, indent=1) if args.json else "\n".join("\t".join(row.values()) for row in rows))
    return 0
