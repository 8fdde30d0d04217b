"""Whether the camera of a robot is where its calibration has it: a frame, judged as by `dxb check calibration`."""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options

if TYPE_CHECKING:
    from dextera_build.artifacts.cameras.camera import Camera
    from dextera_build.artifacts.robots.robot import RobotModel
    from dextera_build.deploying.cell import RosCell
    from dextera_build.deploying.checkup import Check
    from dextera_build.deploying.topics import Topics
    from dextera_build.deploying.transport import Transport

INPUT = "now"
"""Input of the recipe that takes the frame, as in `capture/camera_moved`."""
WHAT = "the camera is where it was calibrated"
WAIT_S = 5.0
"""Longest time until the camera says its intrinsics [s]."""
MENDS = {
    1: "put the camera back, or calibrate it again and build the cell anew ({calibrated})",
    3: "let the camera see the board larger, or give several pictures to `dxb check calibration {node}`",
    4: "mount the board as in the calibration, wholly in view of the camera; see what the build says above",
}
"""Exit code of `dxb check calibration` -> what to do."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the doctor."""
    parser.add_argument(
        "--calibration",
        metavar="RECIPE:NODE",
        help="judge a frame with the mounted board by this node of align.camera_motion, capture/camera_moved:moved",
    )
    parser.add_argument(
        "--input",
        dest="calibrated",
        action="append",
        default=[],
        metavar="NAME=PATH",
        help="input of that recipe, as capture=calibration",
    )


def checks(
    args: argparse.Namespace, transport: Transport, topics: Topics, cell: RosCell, robot: RobotModel
) -> tuple[Check, ...]:
    """The check of one frame; none if no calibration is stated.

    Args:
        args: The arguments.
        transport: Connected to the robot.
        topics: Its topics, with the camera.
        cell: Has received pictures and joint states.
        robot: The model.
    """
    from dextera_build.deploying.checkup import Check

    if not args.calibration:
        return ()
    camera, why = _lens(transport, topics, args.camera)
    picture, state = cell.pictures[args.camera].last, cell.state
    if camera is None or picture is None or state.last is None:
        return (Check(WHAT, False, why or "no picture with its intrinsics arrived", "see the driver of the camera"),)
    joints = (state.nearest(picture.stamp) or state.last).value
    names = [joint.name for joint in robot.joints]
    with tempfile.TemporaryDirectory(prefix="dxb-camera-") as folder:
        written(Path(folder), picture.value, camera, dict(zip(names, map(float, joints), strict=True)))
        code, found = _judged(args, folder)
    mend = MENDS.get(code, "").format(node=args.calibration, calibrated="`dxb build` of its recipe")
    return (Check(WHAT, code == 0, found, mend),)


def written(folder: Path, picture: Any, camera: Camera, joints: dict[str, float]) -> None:
    """Write a frame as `capture.robot_views` reads it.

    Args:
        folder: Where.
        picture: `sensor_msgs/CompressedImage`.
        camera: Its intrinsics.
        joints: Joint -> position then [rad or m].
    """
    from PIL import Image

    from dextera_build.formats.ros import images

    Image.fromarray(images.pixels(picture, "picture")).save(folder / "rgb_0.png")
    facts = {**camera.model_dump(), "setup": "eye-to-hand", "views": [{"rgb": "rgb_0.png", "joints": joints}]}
    (folder / "capture.json").write_text(json.dumps(facts))


def _judged(args: argparse.Namespace, folder: str) -> tuple[int, str]:
    """Exit code of `dxb check calibration`, and what it says."""
    from dextera_build.cli.build import check_calibration

    asked = argparse.Namespace(**{**vars(args), "input": [*args.calibrated, f"{INPUT}={folder}"]})
    rows = check_calibration.found(asked, [args.calibration], options.project(args))
    return (4, "the frame could not be judged") if rows is None else (rows[0].code, rows[0].line)


def _lens(transport: Transport, topics: Topics, name: str) -> tuple[Camera | None, str]:
    """Intrinsics of the camera, and why they cannot be used; None if it does not say them."""
    from dextera_build.deploying import tracking, wire

    heard: list[bytes] = []
    info = tracking.info_of(topics, name)
    transport.subscribe(info, lambda message, _: heard.append(message))
    end = time.monotonic() + WAIT_S
    while not heard and time.monotonic() < end:
        time.sleep(0.05)
    try:
        return (tracking.intrinsics(info, heard[-1]) if heard else None), ""
    except wire.UnusableError as error:
        return None, str(error)
