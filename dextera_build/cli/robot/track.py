"""`dxb robot track`: publish where the objects of a task are in the pictures of a robot's camera."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from typing import TYPE_CHECKING, Any

from dextera_build.cli import built, options, table
from dextera_build.cli.robot import connected

if TYPE_CHECKING:
    from dextera_build.artifacts.cameras.camera import Camera
    from dextera_build.artifacts.robots.cell import Cell
    from dextera_build.artifacts.tasks.task import TaskBundle
    from dextera_build.deploying.photographed import Scene
    from dextera_build.deploying.tracking import ObjectTracker, Watched
    from dextera_build.tracking.tracked_object import Status

READY = "tracking"
"""First word on stderr once objects are tracked."""
WAIT_S = 20.0
"""Longest time until the camera and the robot publish [s]."""
LOOK_S = 0.002
"""Time between two looks for a new frame [s]."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    connected.arguments(parser)
    cell_arguments(parser)
    parser.add_argument("--parent", type=int, metavar="PID", help=argparse.SUPPRESS)
    parser.add_argument("--robot", metavar="HOST", default="127.0.0.1", help="address of the robot (127.0.0.1)")
    read = options.number("--seconds", 0.0, float("inf"))
    parser.add_argument("--seconds", type=read, default=float("inf"), metavar="S", help="end after this time")


def cell_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that state what the tracker knows."""
    parser.add_argument(
        "--cell", metavar="RECIPE:NODE", help="track objects with the assets and calibration of simulate.cell"
    )
    parser.add_argument(
        "--photograph",
        metavar="RECIPE:NODE",
        help="learn what objects look like from this capture with depth (a drawing of the twin)",
    )


def run(args: argparse.Namespace) -> int:
    """Track until interrupted; what happened goes to stdout.

    Raises:
        UsageError: No cell is stated.
        MachineError: The camera or the robot is silent, or what they publish cannot be used.
    """
    from dextera_build.artifacts.robots.cell import Cell
    from dextera_build.deploying.tracking import ObjectTracker, Watched
    from dextera_build.errors import UsageError
    from dextera_build.sim.runtime.cell_tracker import CellTracker
    from dextera_build.sim.runtime.tracked_cell import check

    if not args.cell:
        raise UsageError(
            "`dxb robot track` needs the assets and the calibration", code="DXB-U350", hint="`--cell RECIPE:NODE`"
        )
    here = connected.opened(args)
    bundle, cell = here.bundle, built.artifact(args, args.cell, Cell)
    check(cell, bundle, bundle)
    there = connected.watched(args, here)
    transport = connected.transport(args, (args.robot,))
    try:
        watched = Watched(transport, there, bundle)
        camera = _camera(watched)
        scene = _scene(args, bundle, cell, camera)
        with CellTracker(cell, bundle, bundle.objects, bundle, camera) as tracker:
            made = ObjectTracker(transport, there, bundle, tracker, scene)
            told = _followed(watched, made, args.seconds, args.parent)
    finally:
        transport.close()
    text = "\n".join(f"{name}\t{value}" for name, value in told.items())
    table.say("robot.track", told, text, as_json=args.json)
    return 0


def _camera(watched: Watched) -> Camera:
    """Wait for the first frame; the intrinsics of its camera.

    Raises:
        MachineError: Nothing arrives.
    """
    from dextera_build.errors import MachineError, listing

    end = time.monotonic() + WAIT_S
    while missing := watched.missing():
        if time.monotonic() > end:
            raise MachineError(
                f"nothing arrived on {listing(missing)} in {WAIT_S:g} s",
                code="DXB-E444",
                hint="start the driver of the camera; name its topics in the robot's `simulate.ros_names`",
            )
        time.sleep(0.05)
    assert watched.camera is not None
    return watched.camera


def _scene(args: argparse.Namespace, bundle: TaskBundle, cell: Cell, camera: Camera) -> Scene:
    from dextera_build.artifacts.cameras.camera import Capture
    from dextera_build.deploying import photographed

    if args.photograph:
        return photographed.pictured(built.artifact(args, args.photograph, Capture), camera)
    return photographed.drawn(bundle, cell, camera)


def _followed(watched: Watched, tracker: ObjectTracker, seconds: float, parent: int | None) -> dict[str, Any]:
    """Track each newest frame, and tell what was found and lost; returns what happened.

    It ends with the process `parent`, if it has one: a run that was killed leaves no tracker behind.
    """
    from dextera_build.deploying.driving import quantiles

    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(1))
    times, tracked = list[float](), dict.fromkeys(tracker.status, 0)
    before: dict[str, Status] = {}
    end = time.monotonic() + seconds
    while not ended and time.monotonic() < end and parent in (None, os.getppid()):
        frame = watched.frame()
        if frame is None:
            time.sleep(LOOK_S)
            continue
        begun = time.monotonic()
        tracker.step(*frame)
        times.append(time.monotonic() - begun)
        for name, status in tracker.status.items():
            tracked[name] += status == "tracked"
        _tell(tracker, before)
        before = dict(tracker.status)
    shares = {name: round(count / max(tracker.frames, 1), 4) for name, count in tracked.items()}
    return {"frames": tracker.frames, **quantiles("frame", times), "tracked": shares}


def _tell(tracker: ObjectTracker, before: dict[str, Status]) -> None:
    """Say which objects were found or lost; those that are hidden for a while are not."""
    if not before:
        print(f"{READY} {len(tracker.status)} objects; press Ctrl-C to end", file=sys.stderr, flush=True)
    for name, status in tracker.status.items():
        if (status == "lost") != (before.get(name, "lost") == "lost") or (not before and status == "lost"):
            why = f": {tracker.why[name]}" if status == "lost" else ""
            print(f"{name} is {'lost' if status == 'lost' else 'found'}{why}", file=sys.stderr, flush=True)
