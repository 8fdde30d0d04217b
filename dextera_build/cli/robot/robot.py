"""`dxb robot`: check the connection to a robot, record a demonstration on it, or simulate one."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from contextlib import nullcontext
from typing import TYPE_CHECKING

from dextera_build.cli import table
from dextera_build.cli.robot import connected, record

if TYPE_CHECKING:
    from dextera_build.deploying.faults import Fault
    from dextera_build.deploying.simulated import SimulatedRobot

_ACTIONS = {
    "doctor": "check topics, types, clock and joints of a robot against the model; nothing moves",
    "record": "record a demonstration that another program commands; nothing is sent",
    "simulate": "put a task's world behind the topics of a robot, in real time, for trying without one",
}
LATE_S = 0.5
"""Time by which a simulation may be late before it starts anew from the present time [s]."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    actions = parser.add_subparsers(dest="what", metavar="ACTION", required=True)
    for name, text in _ACTIONS.items():
        sub = actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        connected.arguments(sub)
        if name == "doctor":
            sub.add_argument("--robot", metavar="HOST", default="127.0.0.1", help="address of the robot (127.0.0.1)")
            sub.add_argument("--listen", type=float, default=3.0, metavar="S", help="time to listen in seconds (3)")
        elif name == "record":
            connected.recording_arguments(sub, "recordings")
            sub.add_argument("--limit", type=float, metavar="S", help="longest recording in seconds (of the task)")
        else:
            _simulate_arguments(sub)


def _simulate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--peer", metavar="HOST", action="append", default=[], help="address of a machine that runs dxb"
    )
    parser.add_argument("--seconds", type=float, default=float("inf"), metavar="S", help="end after this time")
    parser.add_argument("--seed", type=int, default=0, help="seed of the start and of losses (0)")
    parser.add_argument("--delay", type=float, default=0.0, metavar="S", help="delay of commands in seconds (0)")
    parser.add_argument("--loss", type=float, default=0.02, help="fraction of lost pictures and poses (0.02)")
    parser.add_argument("--clock", type=float, default=0.0, metavar="S", help="seconds by which the clock is ahead (0)")
    parser.add_argument(
        "--fault",
        metavar="KIND@S",
        action="append",
        default=[],
        help="something that goes wrong some seconds after the first command, KIND@S or KIND@S:DURATION",
    )


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    return {"doctor": _doctor, "record": record.run, "simulate": _simulate}[args.what](args)


def _doctor(args: argparse.Namespace) -> int:
    """Print each check with what mends it; exit with 1 if one failed."""
    from dextera_build.deploying.cell import RosCell
    from dextera_build.deploying.checkup import checkup

    here = connected.opened(args)
    transport = connected.transport(args, (args.robot,))
    try:
        needed = ("rgb",) if here.view else ()
        cell = RosCell(transport, here.topics, here.bundle, needed)
        checks = checkup(transport, here.topics, cell, here.bundle.robot, time.sleep, args.listen)
    finally:
        transport.close()
    rows = connected.shown(checks)
    failed = sum(not each.ok for each in checks)
    text = f"{failed} of {len(checks)} checks failed"
    table.say("robot.doctor", {"checks": rows, "failed": failed}, text, as_json=args.json)
    return 1 if failed else 0


def _simulate(args: argparse.Namespace) -> int:
    """Simulate until interrupted; what happened goes to stdout."""
    from dextera_build.deploying.simulated import SimulatedRobot, Simulation, facts
    from dextera_build.sim.observe import pictures
    from dextera_build.sim.runtime.environment import Environment

    here = connected.opened(args)
    faults = tuple(_fault(text) for text in args.fault)
    environment = Environment(here.bundle)
    environment.begin(environment.draw(args.seed))
    transport = connected.transport(args, tuple(args.peer), simulates=True)
    simulation = Simulation(delay_s=args.delay, loss=args.loss, clock_s=args.clock, faults=faults, seed=args.seed)
    with pictures.live(environment, here.view, ("rgb", "depth")) if here.view else nullcontext() as look:
        robot = SimulatedRobot(transport, here.topics, environment, simulation, look)
        print(
            f"simulated robot in domain {args.domain} by {args.transport}; press Ctrl-C to stop",
            file=sys.stderr,
            flush=True,
        )
        late = _ticking(robot, args.seconds)
    transport.close()
    told = facts(robot) | {"restarts_late": late}
    text = "\n".join(f"{name}\t{value}" for name, value in told.items())
    table.say("robot.simulate", told, text, as_json=args.json)
    return 0


def _ticking(robot: SimulatedRobot, seconds: float) -> int:
    """Advance the robot in real time; returns how often this machine was too slow."""
    from dextera_build.deploying.simulated import STATE_HZ

    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(1))
    due, late, end = time.monotonic(), 0, time.monotonic() + seconds
    while not ended and time.monotonic() < end:
        robot.tick()
        due += 1.0 / STATE_HZ
        left = due - time.monotonic()
        if left > 0:
            time.sleep(left)
        elif left < -LATE_S:
            due, late = time.monotonic(), late + 1
    return late


def _fault(text: str) -> Fault:
    """A fault from `KIND@S` or `KIND@S:DURATION`.

    Raises:
        UsageError: There is no such kind, or a time is no number.
    """
    from dextera_build.deploying.faults import FAULTS, Fault
    from dextera_build.errors import UsageError, listing

    kind, _, when = text.partition("@")
    at, _, lasts = when.partition(":")
    try:
        known = next(each for each in FAULTS if each == kind)
        return Fault(known, float(at), float(lasts or "inf"))
    except (StopIteration, ValueError):
        raise UsageError(
            f"`--fault {text}` is no KIND@S",
            code="DXB-U346",
            facts={"kinds": listing(FAULTS, most=20)},
            hint="`--fault cut@1:0.2`",
        ) from None
