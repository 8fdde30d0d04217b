"""Streams of hands in other axes: y up, reversed, sides exchanged."""

from __future__ import annotations

from typing import Any

import numpy as np

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.geometry import hands, quaternions

AHEAD = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
"""Rotation from WebXR's axes (x right, y up, -z ahead) to z up and x ahead."""


def upright(stream: HandStream) -> HandStream:
    """The stream in a frame whose z is the y of its own, and whose x is ahead of WebXR's viewer."""
    turn = quaternions.from_matrix(AHEAD)

    def turned(rows: np.ndarray) -> np.ndarray:
        return quaternions.multiply(np.broadcast_to(turn, rows.shape), rows).astype(np.float32)

    head = stream.head
    return _with(
        stream,
        positions=(stream.positions @ AHEAD.T).astype(np.float32),
        rotations=turned(stream.rotations),
        head=None if head is None else np.hstack([(head[:, :3] @ AHEAD.T).astype(np.float32), turned(head[:, 3:])]),
    )


def without_mirror(stream: HandStream, axis: str) -> HandStream:
    """The stream with one axis of its frame reversed.

    A reflection also reverses one axis of every joint. Which one depends on the device: the axis across the bone, or
    that of the frame; the one is chosen that leaves -Z along the bones.
    """
    number = "xyz".index(axis)
    sign = np.ones(3, np.float32)
    sign[number] = -1
    positions = stream.positions * sign
    ways = [_reflected(stream.rotations, number, local) for local in (0, number)]
    local = (0, number)[int(np.argmax([_along_bones(positions, way) for way in ways]))]
    head = stream.head
    if head is not None:
        head = np.hstack([head[:, :3] * sign, _reflected(head[:, 3:], number, local)])
    return _with(stream, positions=positions, rotations=_reflected(stream.rotations, number, local), head=head)


def with_sides_swapped(stream: HandStream) -> HandStream:
    """The stream with the left hand as the right one."""
    names = ("positions", "rotations", "tracking", "pinch", "clutch")
    return _with(stream, **{name: np.ascontiguousarray(getattr(stream, name)[:, ::-1]) for name in names})


def _with(stream: HandStream, **changes: Any) -> HandStream:
    return HandStream(**dict(stream) | changes)


def _reflected(rotations: np.ndarray, axis: int, local: int) -> np.ndarray:
    """Quaternions (..., 4) of S R L, where S and L reverse an axis each."""
    # S R S has the same angle about the reflected axis in the other sense; S L is a half turn about the third axis.
    kept = np.array([1.0, -1, -1, -1])
    kept[1 + axis] = 1
    found = rotations * kept
    if local != axis:
        half = np.zeros(4)
        half[1 + ({0, 1, 2} - {axis, local}).pop()] = 1
        found = quaternions.multiply(found, np.broadcast_to(half, found.shape))
    return np.asarray(found, np.float32)


def _along_bones(positions: np.ndarray, rotations: np.ndarray) -> float:
    """Mean cosine between the bones of hands and -Z of the joints that they begin with."""
    ends = [joint for joint, parent in enumerate(hands.PARENTS) if parent > hands.WRIST]
    starts = [hands.PARENTS[joint] for joint in ends]
    bones = positions[..., ends, :] - positions[..., starts, :]
    back = quaternions.to_matrices(rotations[..., starts, :])[..., 2]
    cosines = -(bones * back).sum(axis=-1) / np.linalg.norm(bones, axis=-1)
    return float(np.nanmean(cosines)) if np.isfinite(cosines).any() else 0.0
