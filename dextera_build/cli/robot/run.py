"""`dxb run`: run a policy that was built on a robot, or replay an episode on it."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options
from dextera_build.cli.robot import acting, beside, connected, stopping, track

if TYPE_CHECKING:
    from dextera_build.cli.robot.connected import Connected
    from dextera_build.deploying.bag import Bag
    from dextera_build.deploying.cell import RosCell, Safety
    from dextera_build.deploying.driving import Drive

MOST_RAMP_S = 60.0
"""Longest ramp [s]."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    connected.arguments(parser)
    acting.arguments(parser)
    track.cell_arguments(parser)
    connected.recording_arguments(parser, "runs")
    connected.limit_argument(parser, "run")
    parser.add_argument(
        "--speed",
        type=options.number("--speed", 0.0, 1.0, above=True),
        default=0.5,
        help="fraction of the joints' speed limits, above 0 to 1 (0.5)",
    )
    parser.add_argument(
        "--ramp",
        type=options.number("--ramp", 0.0, MOST_RAMP_S),
        default=1.5,
        metavar="S",
        help="time until that speed is allowed (1.5)",
    )
    parser.add_argument(
        "--pedal",
        metavar="DEVICE",
        help="input device whose keys stop the run, /dev/input/by-id/...-event-kbd; keys of the terminal do, too",
    )
    parser.add_argument(
        "--asynchronous",
        action="store_true",
        help="ask the policy in a thread of its own while the robot carries out the steps of its last answer",
    )
    parser.add_argument(
        "--real-time-chunking",
        action="store_true",
        help="the same, and its next answer continues these steps; for policies of learn.diffusion",
    )


def run(args: argparse.Namespace) -> int:
    """Check the robot, run the policy, and write the recording; exit with 1 unless the run ended by itself."""
    from dextera_build.deploying.bag import ABOUT
    from dextera_build.deploying.cell import RosCell
    from dextera_build.deploying.driving import facts
    from dextera_build.running import called

    safety = _safety(args)
    here = connected.opened(args)
    with called.shown(here.session.project.library):
        found = acting.found(args, here)
        out = connected.recording(args, here, "runs")
        with beside.tracker(args), connected.recorded(args, out) as (transport, bag):
            lenses = {name: view.camera for name, view in here.views.items()}
            cell = RosCell(transport, here.topics, here.bundle, found.needed, safety, bag, lenses=lenses)
            connected.refuse(args, here, transport, cell)
            bag.describe(here.bundle, time.time_ns())
            bag.state(ABOUT, time.time_ns(), facts(cell, here.bundle) | found.about)
            ran, told = _driven(args, here, cell, found, bag)
    connected.tell(args, told, out)
    return 1 if ran.faulty else 0


def _safety(args: argparse.Namespace) -> Safety:
    """The limits that the arguments and the cell state."""
    from dextera_build.deploying.cell import GUARDED, Safety

    limits = GUARDED.model_copy(update={"speed": args.speed})
    return Safety(limits=connected.kept(args, limits), ramp_s=args.ramp)


def _driven(
    args: argparse.Namespace, here: Connected, cell: RosCell, found: acting.Found, bag: Bag
) -> tuple[Drive, dict[str, Any]]:
    """What happened, and as plain data with what the policy's thread did."""
    import numpy as np

    from dextera_build.deploying.ahead import Ahead
    from dextera_build.deploying.driving import drive
    from dextera_build.sim.primitives import catalogue

    task = here.bundle.task
    goal = catalogue.of(task, here.bundle.objects).goal.numbers(here.bundle.base_pose.inverse().matrix)
    asked = found.asked_by(cell, args.asynchronous)
    with stopping.stops(args.pedal) as halt:
        keys = "any key" if sys.stdin.isatty() else "Ctrl-C"
        print(
            f"{task.name} at {task.control_hz:g} Hz on {args.robot}; press {keys} to stop", file=sys.stderr, flush=True
        )
        ran = drive(
            cell,
            asked,
            np.array(goal, np.float32),
            rate_hz=task.control_hz,
            limit_s=args.limit or found.limit_s or task.timeout_s,
            added=cell.mirror.added(found.terms),
            halt=halt,
        )
    told = ran.facts() | (asked.facts() if isinstance(asked, Ahead) else {})
    connected.judged(args, bag, told, ran.success)
    return ran, told
