"""Messages between the page and the session: hands to it as binary frames, its state back as JSON with poses.

A frame of hands is, little-endian: number (u32), kind (u8: 0 joints, 1 posture), joints per hand (u8), axes (u16: 0
those of WebXR's `local-floor`, y up; 1 those of the robot's base), time of the page [ms] (f64), tracking and clutch of
left and right (4 x u8), pinch of both (2 x f32), head (7 x f32), and then for each hand either its joints (25 x 7 x
f32) or its wrist and how far it is closed (8 x f32). Poses are position [m] and quaternion x y z w, as WebXR has them.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, TRACKED
from dextera_build.geometry import hands, lie, quaternions
from dextera_build.sim.experts.live_operator import Message, Refused
from dextera_build.teleop import posture

HEAD = struct.Struct("<IBBHd4B9f")
JOINTS, POSTURE = 0, 1
WEBXR, BASE = 0, 1
LARGEST = 4096
"""Largest message that a page sends [byte]: a frame with all joints has 1,456."""
FAR_M = 100.0
"""Positions beyond this are no hand's [m]."""
FLAT_M = 1e-3
"""A palm whose knuckles are nearer than this to one line through the wrist is no hand's [m]."""
AHEAD = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
"""Rotation of the axes of WebXR's frame (y up, -z ahead) into one with z up and x ahead."""


class Frame(NamedTuple):
    """A frame of hands."""

    message: Message
    """The hands, in the base frame."""
    page_ms: float
    """Time of the page when it was sent [ms]."""
    measured: bool
    """Whether the joints are measured, so that the size of the hand is the operator's."""


def frame(data: bytes, arrived: float, heading_rad: float) -> Frame:
    """Read a frame of hands.

    Args:
        data: The message.
        arrived: When it came, by `time.perf_counter` [s].
        heading_rad: Angle about the vertical from the operator's axes to those of the robot's base [rad].

    Raises:
        Refused: It has another size, number of joints or kind, or a tracked hand has numbers that are not finite, or
            no palm.
    """
    if len(data) < HEAD.size:
        raise Refused(f"a frame of hands has {len(data)} bytes; its head alone has {HEAD.size}")
    number, kind, joints, axes, page_ms, *rest = HEAD.unpack_from(data)
    tracking, clutch = np.array(rest[:2], np.uint8), np.array(rest[2:4], bool)
    if kind not in (JOINTS, POSTURE) or axes not in (WEBXR, BASE) or tracking.max() > TRACKED:
        raise Refused(f"a frame of kind {kind}, axes {axes} and tracking {tracking.tolist()} is unknown")
    if kind == JOINTS and joints != len(hands.JOINTS):
        raise Refused(f"a hand has {joints} joints instead of {len(hands.JOINTS)}")
    shape = (2, joints, 7) if kind == JOINTS else (2, 8)
    if len(data) != HEAD.size + 4 * int(np.prod(shape)):
        raise Refused(f"a frame of hands has {len(data)} bytes instead of {HEAD.size + 4 * int(np.prod(shape))}")
    values = np.frombuffer(data, "<f4", offset=HEAD.size).reshape(shape).astype(np.float64)
    _check(values, tracking)
    if kind == JOINTS:
        _check_palms(values, tracking)
    poses = values if kind == JOINTS else posture.joints(values[:, :7], values[:, 7])
    poses = np.where(tracking[:, None, None] > LOST, poses, np.nan)
    turn = lie.about_z(heading_rad) @ AHEAD if axes == WEBXR else np.eye(3)
    positions, rotations = _turned(poses, turn)
    head = _turned(np.array(rest[6:13])[None, None], turn)
    message = Message(
        number,
        arrived,
        positions,
        rotations,
        tracking,
        clutch & (tracking > LOST),
        np.nan_to_num(np.clip(np.array(rest[4:6], np.float32), 0, 1)),
        np.concatenate([head[0][0, 0], head[1][0, 0]]),
    )
    return Frame(message, float(page_ms), kind == JOINTS)


def _check(values: np.ndarray, tracking: np.ndarray) -> None:
    for hand, side in enumerate(hands.SIDES):
        if tracking[hand] == LOST:
            continue
        if not np.isfinite(values[hand]).all():
            raise Refused(f"the {side} hand is tracked, but has numbers that are not finite")
        if np.abs(values[hand][..., :3]).max() > FAR_M:
            raise Refused(f"the {side} hand is farther away than {FAR_M:g} m")
        if not (np.linalg.norm(values[hand][..., 3:7], axis=-1) > 0.5).all():
            raise Refused(f"the {side} hand has rotations that are no unit quaternions")


def _check_palms(values: np.ndarray, tracking: np.ndarray) -> None:
    """Refuse joints (2, 25, 7) in which a tracked hand has no palm, whose axes would be no numbers."""
    for hand in np.flatnonzero(tracking > LOST):
        points = values[hand, :, :3]
        index, middle, little = (points[hands.KNUCKLES[finger]] - points[hands.WRIST] for finger in (1, 2, 4))
        apart = np.linalg.norm(np.cross(little, index)) / max(float(np.linalg.norm(index)), FLAT_M)
        if min(apart, np.linalg.norm(middle)) < FLAT_M:
            raise Refused(f"the wrist and the knuckles of the {hands.SIDES[hand]} hand lie on one line")


def _turned(poses: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (..., 3) and quaternions w x y z (..., 4), float32, of poses with x y z w, turned by (3, 3)."""
    found = quaternions.multiply(quaternions.from_matrix(turn), poses[..., [6, 3, 4, 5]])
    with np.errstate(invalid="ignore"):
        found /= np.linalg.norm(found, axis=-1, keepdims=True)
    return (poses[..., :3] @ turn.T).astype(np.float32), found.astype(np.float32)


def command(text: str) -> Mapping[str, Any]:
    """Read a command of the page, a JSON object.

    Raises:
        Refused: It is none.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):  # the latter from lists within lists without end
        found = None
    if not isinstance(found, dict):
        raise Refused("a command is a JSON object")
    return found


def state(facts: Mapping[str, Any], *poses: np.ndarray) -> bytes:
    """A state for the page: length of the JSON text (u32), the text, filled to 4 bytes, and float32 numbers."""
    text = json.dumps(facts, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + b"".join(np.ascontiguousarray(p, "<f4").tobytes() for p in poses)
