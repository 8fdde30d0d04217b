"""`dxb robot`: check the connection to a robot, track its objects, record a demonstration on it, or simulate one."""

from __future__ import annotations

import argparse
import time

from dextera_build.cli import options, table
from dextera_build.cli.robot import beside, connected, drift, record, simulate, track

_ACTIONS = {
    "doctor": "check topics, types, clock and joints of a robot against the model; nothing moves",
    "track": "track a task's objects in the pictures of a robot, and publish where they are",
    "record": "record a demonstration that another program commands; nothing is sent",
    "simulate": "put a task's world behind the topics of a robot, in real time, for trying without one",
}

MOST_LISTEN_S = 600.0
"""Longest time for which the checks listen [s]."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    actions = parser.add_subparsers(dest="what", metavar="ACTION", required=True)
    for name, text in _ACTIONS.items():
        sub = actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        if name == "track":
            track.arguments(sub)
            continue
        connected.arguments(sub)
        if name != "simulate":
            track.cell_arguments(sub)
        if name == "doctor":
            drift.arguments(sub)
            sub.add_argument("--robot", metavar="HOST", default="127.0.0.1", help="address of the robot (127.0.0.1)")
            read = options.number("--listen", 0.0, MOST_LISTEN_S, above=True)
            sub.add_argument("--listen", type=read, default=3.0, metavar="S", help="time to listen in seconds (3)")
        elif name == "record":
            connected.recording_arguments(sub, "recordings")
            connected.limit_argument(sub, "recording")
        else:
            simulate.arguments(sub)


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    return {"doctor": _doctor, "track": track.run, "record": record.run, "simulate": simulate.run}[args.what](args)


def _doctor(args: argparse.Namespace) -> int:
    """Print each check with what mends it; exit with 1 if one failed."""
    from dextera_build.deploying.cell import GUARDED, RosCell, Safety
    from dextera_build.deploying.checkup import checkup

    here = connected.opened(args)
    shows = here.views or args.calibration
    topics = here.topics if here.views or not shows else connected.watched(args, here)
    needed = [*(("rgb",) if shows else ()), *(record.NEEDED if args.cell else ())]
    safety = Safety(limits=connected.kept(args, GUARDED))
    with beside.tracker(args):
        transport = connected.transport(args, (args.robot,))
        try:
            cell = RosCell(transport, topics, here.bundle, needed, safety)
            checks = checkup(transport, topics, cell, here.bundle.robot, time.sleep, args.listen)
            checks += drift.checks(args, transport, topics, cell, here.bundle.robot)
        finally:
            transport.close()
    rows = connected.shown(checks)
    failed = sum(not each.ok for each in checks)
    text = f"{failed} of {len(checks)} checks failed"
    table.say("robot.doctor", {"checks": rows, "failed": failed}, text, as_json=args.json)
    return 1 if failed else 0
