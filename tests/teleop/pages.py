"""A page of a live session for tests: frames of hands as the page sends them."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import hands
from dextera_build.teleop import protocol

HEAD = (0.0, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0)


def joints(hand: np.ndarray, number: int = 1, *, count: int = len(hands.JOINTS), tracking: int = 2) -> bytes:
    """A frame of joints (2, count, 7) in WebXR's axes, with closed clutches and a head that looks ahead."""
    return head(number, protocol.JOINTS, count, protocol.WEBXR, tracking) + hand.astype("<f4").tobytes()


def wrists(closed: float, number: int = 1, axes: int = protocol.BASE, turned_rad: float = 0.0) -> bytes:
    """A frame of wrists at the origin, with both hands closed that far, and the head turned about y."""
    row = [0, 0, 0, 0, 0, 0, 1, closed]
    looks = (*HEAD[:3], 0.0, np.sin(turned_rad / 2), 0.0, np.cos(turned_rad / 2))
    return head(number, protocol.POSTURE, 0, axes, looks=looks) + np.array([row, row], "<f4").tobytes()


def head(number: int, kind: int, count: int, axes: int, tracking: int = 2, looks: tuple[float, ...] = HEAD) -> bytes:
    """The first part of a frame."""
    return protocol.HEAD.pack(number, kind, count, axes, 12.5, tracking, tracking, 1, 1, 0.5, 0.25, *looks)


def opened() -> np.ndarray:
    """Joints (2, 25, 7) of open hands in WebXR's axes, half a metre ahead of the head."""
    from dextera_build.teleop import posture

    places = [[-0.2, 1.2, -0.5, 0, 0, 0, 1], [0.2, 1.2, -0.5, 0, 0, 0, 1]]
    return posture.joints(np.array(places, np.float64), np.zeros(2))
