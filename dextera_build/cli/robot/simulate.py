"""`dxb robot simulate`: put a task's world behind the topics of a robot, in real time."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from dextera_build.cli import built, options, table
from dextera_build.cli.robot import connected, episodes

if TYPE_CHECKING:
    from dextera_build.artifacts.robots.cell import Cell
    from dextera_build.cli.robot.connected import Connected
    from dextera_build.deploying.apart import Opens
    from dextera_build.deploying.faults import Fault
    from dextera_build.deploying.simulated import SimulatedRobot
    from dextera_build.policy.observation import Frames
    from dextera_build.sim.runtime.environment import Environment

MOST_CLOCK_S = 1e6
"""Most by which the clock of the stamps may be off [s]."""
SWITCH_S = 0.001
"""How long the camera may keep the interpreter from the joint states [s]."""
LATE_S = 0.5
"""Time by which a simulation may be late before it starts anew from the present time [s]."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that simulations alone have."""
    parser.add_argument(
        "--peer", metavar="HOST", action="append", default=[], help="address of a machine that runs dxb"
    )
    parser.add_argument(
        "--cell",
        metavar="RECIPE:NODE",
        help="show pictures and depth of the camera of simulate.cell, with its noise, and publish no poses of objects",
    )
    number, endless = options.number, float("inf")
    parser.add_argument(
        "--seconds", type=number("--seconds", 0.0, endless), default=endless, metavar="S", help="end after this time"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the start and of losses (0)")
    parser.add_argument(
        "--start", metavar="RECIPE:NODE", help="begin as an episode of this set began, for `dxb run --replay`"
    )
    episodes.number_argument(parser)
    parser.add_argument(
        "--delay", type=number("--delay", 0.0, 60.0), default=0.0, metavar="S", help="delay of commands in seconds (0)"
    )
    parser.add_argument(
        "--loss", type=number("--loss", 0.0, 1.0), default=0.02, help="fraction of lost pictures and poses (0.02)"
    )
    parser.add_argument(
        "--clock",
        type=number("--clock", -MOST_CLOCK_S, MOST_CLOCK_S),
        default=0.0,
        metavar="S",
        help="seconds by which the clock is ahead (0)",
    )
    parser.add_argument(
        "--fault",
        metavar="KIND@S",
        action="append",
        default=[],
        help="something that goes wrong some seconds after the first command, KIND@S or KIND@S:DURATION",
    )


def run(args: argparse.Namespace) -> int:
    """Simulate until interrupted; what happened goes to stdout."""
    from dextera_build.deploying.apart import Apart
    from dextera_build.deploying.simulated import SimulatedRobot, Simulation, facts
    from dextera_build.sim.runtime.environment import Environment

    here, cell = connected.opened(args), _cell(args)
    environment = Environment(here.bundle)
    _begin(args, here, environment, seen=cell is not None)
    transport = connected.transport(args, tuple(args.peer), simulates=True)
    simulation = Simulation(
        picture_hz=Simulation.picture_hz if cell is None else cell.rate_hz,
        delay_s=args.delay,
        loss=args.loss,
        tracks=cell is None,
        clock_s=args.clock,
        faults=tuple(_fault(text) for text in args.fault),
        seed=args.seed,
    )
    topics, camera = (here.topics, None) if cell is None else (connected.watched(args, here), cell.camera)
    opens = _opens(here, cell, args)
    # Frames take long: joint states, which the guard of a run waits for, are not held up by them.
    sys.setswitchinterval(SWITCH_S)
    with nullcontext() if opens is None else Apart(environment, opens) as look:
        robot = SimulatedRobot(transport, topics, environment, simulation, look, camera)
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


def _begin(args: argparse.Namespace, here: Connected, environment: Environment, *, seen: bool) -> None:
    """Begin at a drawn start, or as an episode did; `seen`: whether the robot has the camera of a cell."""
    from dextera_build.artifacts.tasks.variation import EXACT
    from dextera_build.deploying import replaying

    if args.start:
        replaying.begin(environment, episodes.chosen(args, args.start, here.bundle), args.seed)
        return
    start = environment.draw(args.seed)
    # The cell's camera has the error of its calibration already; an error of the base would be a second one.
    environment.begin(start.model_copy(update={"base_error": EXACT}) if seen else start)


def _cell(args: argparse.Namespace) -> Cell | None:
    """The cell whose camera is simulated, if one is stated.

    Raises:
        UsageError: A view is stated, too.
    """
    from dextera_build.artifacts.robots.cell import Cell
    from dextera_build.errors import UsageError

    if args.cell and args.view:
        raise UsageError(
            "a simulated robot has the camera of `--cell`, or those of `--view`",
            code="DXB-U351",
            hint="`--cell` for a tracker, `--view` for a policy that takes pictures",
        )
    return built.artifact(args, args.cell, Cell) if args.cell else None


def _opens(here: Connected, cell: Cell | None, args: argparse.Namespace) -> Opens | None:
    """Opens the stated cameras of a world; None: there is none."""
    if cell is None and not here.views:
        return None

    @contextmanager
    def opens(environment: Environment) -> Iterator[Callable[[], Frames]]:
        import numpy as np

        from dextera_build.policy.observation import Frame
        from dextera_build.sim.observe import pictures
        from dextera_build.sim.runtime.cell_camera import CellCamera

        if cell is None:
            with pictures.live(environment, here.views, ("rgb", "depth")) as look:
                yield look
            return
        random = np.random.default_rng([args.seed, cell.seed, 3])
        with CellCamera(environment, cell) as camera:
            yield lambda: {args.camera: Frame(*camera.measured(camera.picture(), random))}

    return opens


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
        read = options.number("--fault", 0.0, float("inf"))
        return Fault(known, read(at), read(lasts or "inf"))
    except (StopIteration, UsageError):
        raise UsageError(
            f"`--fault {text}` is no KIND@S",
            code="DXB-U346",
            facts={"kinds": listing(FAULTS, most=20)},
            hint="`--fault cut@1:0.2`",
        ) from None
