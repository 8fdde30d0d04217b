"""`dxb robot record`: record a demonstration on a robot that another program commands."""

from __future__ import annotations

import argparse
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from dextera_build.cli.robot import beside, connected, stopping

if TYPE_CHECKING:
    from dextera_build.deploying.demonstration import Demonstration

NEEDED = ("objects", "displacement")
"""What an episode holds besides the robot's joints."""
LOOK_S = 0.02
"""Time between two looks for the first command [s]."""
TELL_S = 5.0
"""Time after which it is told which joints lack a command [s]."""


def run(args: argparse.Namespace) -> int:
    """Record until the task is done, the time is over, or Ctrl-C; exit with 1 if measurements failed."""
    from dextera_build.deploying.bag import ABOUT
    from dextera_build.deploying.cell import RosCell
    from dextera_build.deploying.demonstration import Demonstration
    from dextera_build.deploying.driving import facts

    here = connected.opened(args)
    out = connected.recording(args, here, "recordings")
    with beside.tracker(args), connected.recorded(args, out) as (transport, bag):
        # Pictures of a camera that stops are no pictures of the demonstration.
        cell = RosCell(transport, here.topics, here.bundle, (*NEEDED, *(("rgb",) if here.views else ())), bag=bag)
        made = Demonstration(transport, here.topics, here.bundle, cell, bag)
        connected.refuse(args, here, transport, cell, commands=False)
        bag.describe(here.bundle, time.time_ns())
        about = {"policy": "", "algorithm": "", "origin": "operator"}
        bag.state(ABOUT, time.time_ns(), facts(cell, here.bundle) | about)
        reason, faulty = _recorded(made, cell.rate_hz, args.limit or here.bundle.task.timeout_s)
        made.end(reason)
        told = {"reason": reason, "success": made.success, "steps": made.steps}
        connected.judged(args, bag, told, made.success)
    connected.tell(args, told, out)
    return 1 if faulty else 0


def _await_commands(
    made: Demonstration,
    sleep: Callable[[float], None] = time.sleep,
    now: Callable[[], float] = time.monotonic,
    ended: Callable[[], bool] = lambda: False,
) -> None:
    """Wait until every joint was commanded, and tell which one was not."""
    told, due = "", now() + TELL_S
    while not (made.commanded or ended()):
        if now() > due and (waits := made.waits_for()) != told:
            told, due = waits, now() + TELL_S
            print(f"no command yet for {told}", file=sys.stderr, flush=True)
        sleep(LOOK_S)


def _recorded(made: Demonstration, rate_hz: float, limit_s: float) -> tuple[str, bool]:
    """Record in real time from the first command on; why it ended, and whether that was a fault."""
    from dextera_build.deploying.driving import DONE, LATE
    from dextera_build.errors import DxbError

    print("waiting for the first command; press Ctrl-C to end", file=sys.stderr, flush=True)
    halt = threading.Event()
    try:
        with stopping.signals(halt):
            _await_commands(made, ended=halt.is_set)
            if not halt.is_set():
                made.begin()
            due = time.monotonic()
            while not (halt.is_set() or made.success or made.steps >= limit_s * rate_hz):
                made.step()
                due = max(due + 1.0 / rate_hz, time.monotonic())
                time.sleep(max(0.0, due - time.monotonic()))
    except KeyboardInterrupt:
        halt.set()
    except DxbError as fault:
        return fault.message, True
    if halt.is_set() and not made.success:
        return "the operator ended it", False
    return (DONE if made.success else LATE.format(limit_s)), False
