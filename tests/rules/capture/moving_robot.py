"""A robot of three hinges that moves between rests, and a camera that sees it: recordings of both."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.formats import mcap
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.recording import Recording, packed
from dextera_build.testing import RuleRunner

START = 1.7e9
CAMERA = Camera(width=96, height=72, fx=90.0, fy=90.0, cx=47.5, cy=35.5)
NAMES = ("a", "b", "c")
POSTURES = np.array(
    [[0.1, 0.4, 0.2], [0.7, 0.9, -0.3], [-0.6, 1.3, 0.5], [1.2, 0.2, 0.9], [-1.1, 1.0, -0.8], [0.4, 1.8, 1.1]]
)
"""Where the robot rests; the limits of its joints differ, so that no other order fits."""
LIMITS = {"a": (-1.4, 1.4), "b": (0.1, 2.4), "c": (-0.9, 1.2)}
OFFSET = 0.16
"""How far the robot's clock is ahead of the camera's [s]."""


def postures(times: np.ndarray) -> np.ndarray:
    """(N, 3) joint positions at times since the start: rests of 1 s, and motions of 0.7 to 1.2 s."""
    found = np.repeat(POSTURES[:1], len(times), axis=0)
    start = 1.0
    for number in range(1, len(POSTURES)):
        length = 0.7 + 0.1 * number
        part = np.clip((times - start) / length, 0.0, 1.0)[:, None]
        found = found + (part * part * (3 - 2 * part)) * (POSTURES[number] - POSTURES[number - 1])
        start += length + 1.0
    return found


LENGTH = 1.0 + sum(0.7 + 0.1 * n for n in range(1, 6)) + 5.0


@functools.cache
def backdrop() -> np.ndarray:
    random = np.random.default_rng(0)
    return np.clip(ndimage.gaussian_filter(random.normal(0, 1, (300, 400)), 2) * 400 + 120, 0, 255)


def picture(posture: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A textured patch that moves with the joints before a texture that does not."""
    found = backdrop()[:72, :96].copy()
    column, row = int(30 + 14 * posture[0] + 6 * posture[2]), int(10 + 12 * posture[1])
    found[row : row + 24, column : column + 24] = backdrop()[200 : 200 + 24, 200 : 200 + 24][:, ::-1]
    noisy = found + random.normal(0, 2.0, found.shape)
    return np.repeat(np.clip(noisy, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def states(**changes: Any) -> Joints:
    """Joint states at 100 Hz on the robot's clock."""
    random = np.random.default_rng(1)
    times = np.arange(0.0, LENGTH, 0.01)
    positions = postures(times) + random.normal(0, 1e-4, (len(times), 3))
    found = {"names": NAMES, "stamps": START + OFFSET + times, "positions": positions, **changes}
    return Joints(**found)


@functools.cache
def frames(rate: float = 30.0) -> dict[float, np.ndarray]:
    """Pictures on the camera's clock."""
    random = np.random.default_rng(2)
    times = np.arange(0.02, LENGTH - 0.02, 1 / rate)
    return {START + float(time): picture(row, random) for time, row in zip(times, postures(times), strict=True)}


def recording(path: Path, joints: Joints | None, more: dict[str, Camera] | None = None, rate: float = 30.0) -> Stream:
    """An MCAP recording with one camera per name."""
    with path.open("wb") as out, Recording(out) as file:
        for name, camera in {"/camera": CAMERA, **(more or {})}.items():
            stamp = round(START * 1e9)
            file.send(f"{name}/camera_info", "sensor_msgs/CameraInfo", stamp, messages.camera_info(stamp, "c", camera))
            for time, pixels in frames(rate).items():
                stamp = round(time * 1e9)
                message = messages.compressed_image(stamp, "c", "png", packed(pixels, "png"))
                file.send(f"{name}/color/compressed", "sensor_msgs/CompressedImage", stamp, message)
        if joints is not None:
            for time, row in zip(joints.stamps, joints.positions, strict=True):
                stamp = round(float(time) * 1e9)
                file.send(
                    "/joint_states", "sensor_msgs/JointState", stamp, messages.joint_state(stamp, joints.names, row)
                )
    return mcap.load(path)


def three_hinges(scratch: Path) -> RobotModel:
    """Three hinges about different axes."""
    axes = {"a": (0, 0, 1), "b": (0, 1, 0), "c": (1, 0, 0)}
    piece = {"shape": "box", "half_m": (0.02, 0.02, 0.08), "colour": "grey"}
    matter = {"mass_kg": 1.0, "centre_m": (0, 0, 0), "inertia_kgm2": (0.01, 0.01, 0.01), "pieces": [piece]}
    motor = {"velocity_rad_s": 3.0, "effort_nm": 50, "stiffness_nm_rad": 100, "damping_nms_rad": 10}
    links = [{"name": "base", **matter}]
    for name, axis in axes.items():
        low, high = LIMITS[name]
        joint = {"name": name, "axis": axis, "lower_rad": low, "upper_rad": high, "home_rad": 0.2, **motor}
        links.append({"name": f"link_{name}", "at_m": (0.05, 0, 0.2), "joint": joint, **matter})
    options = {
        "name": "three",
        "source": "the test",
        "colours": {"grey": (0.5, 0.5, 0.5)},
        "chains": [{"group": "arm", "mounts": [{}], "links": links}],
        "frames": {"flange": {"link": "link_c", "at_m": (0, 0, 0.1)}},
    }
    runner = RuleRunner(scratch)
    model: RobotModel = runner.run("simulate.robot", options=options)
    return model
