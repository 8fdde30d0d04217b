"""Human hands as 25 joints in WebXR's order: names, bones, tips, sizes, the palm's frame, and left from right.

Order, names and axes are those of the W3C's WebXR Hand Input Module, section 4 (https://www.w3.org/TR/webxr-hand-input-1):
a joint is the end of its bone that is nearer to the wrist; -Z runs along that bone, away from the wrist, and -Y leaves
the palm's skin at right angles, so that +Y is the back of the hand and +X the right of one who looks along the fingers
at the back, on both hands. A tip has the axes of its last bone. Points are [m] in any one frame; leading axes are free
everywhere, so that a stream (N, 2, 25, 3) is handled like one hand (25, 3).
"""

from __future__ import annotations

import numpy as np

SIDES = ("left", "right")
"""The two hands, in the order of the axis of hands."""
FINGERS = ("thumb", "index", "middle", "ring", "pinky")
"""Fingers in the order of the joints."""
JOINTS = (
    "wrist",
    *("thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip"),
    *(
        f"{finger}-finger-{part}"
        for finger in FINGERS[1:]
        for part in ("metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")
    ),
)
"""Names of the 25 joints as WebXR lists them."""
WRIST = 0
CHAINS = ((1, 2, 3, 4), *(tuple(range(first, first + 5)) for first in (5, 10, 15, 20)))
"""Joints of each finger from its metacarpal to its tip: four of the thumb, five of each other finger."""
TIPS = tuple(chain[-1] for chain in CHAINS)
"""Joint of each finger's tip."""
KNUCKLES = tuple(chain[1] for chain in CHAINS)
"""Joint at which each finger leaves the palm (metacarpophalangeal)."""
PARENTS = (-1, *(WRIST if place == 0 else chain[place - 1] for chain in CHAINS for place in range(len(chain))))
"""Parent of each joint; -1 of the wrist."""
MEDIAPIPE = tuple(joint for joint in range(len(JOINTS)) if joint not in {chain[0] for chain in CHAINS[1:]})
"""Joint of each of MediaPipe's 21 hand landmarks: all but the metacarpals of the four fingers."""
PINCH_M = (0.015, 0.06)
"""Distance of the tips of a closed and of an open pinch, for sources without their own measure [m]."""


def bone_lengths(points: np.ndarray) -> np.ndarray:
    """Lengths (..., 24) [m] of the bones that end in joints 1 to 24, of points (..., 25, 3)."""
    return np.asarray(np.linalg.norm(points[..., 1:, :] - points[..., PARENTS[1:], :], axis=-1))


def finger_lengths(points: np.ndarray) -> np.ndarray:
    """Lengths (..., 5) [m] of the fingers along their bones, knuckle to tip, of points (..., 25, 3)."""
    bones = bone_lengths(points)
    return np.stack([bones[..., [joint - 1 for joint in chain[2:]]].sum(axis=-1) for chain in CHAINS], axis=-1)


def hand_size(points: np.ndarray) -> np.ndarray:
    """Size (...,) [m] of hands (..., 25, 3): wrist to middle knuckle, and the middle finger along its bones.

    It is the same however the fingers are bent, so one frame of any posture measures a hand.
    """
    palm = np.linalg.norm(points[..., KNUCKLES[2], :] - points[..., WRIST, :], axis=-1)
    return np.asarray(palm + finger_lengths(points)[..., 2])


def pinch_distance(points: np.ndarray, finger: str = "index") -> np.ndarray:
    """Distance (...,) [m] between the tips of the thumb and of another finger, of points (..., 25, 3)."""
    tip = TIPS[FINGERS.index(finger)]
    return np.asarray(np.linalg.norm(points[..., tip, :] - points[..., TIPS[0], :], axis=-1))


def pinch(points: np.ndarray) -> np.ndarray:
    """Pinch (...,) of thumb and index finger from the distance of their tips, 0 (open) to 1 (closed)."""
    return np.clip((PINCH_M[1] - pinch_distance(points)) / (PINCH_M[1] - PINCH_M[0]), 0, 1)


def palm_frame(points: np.ndarray, side: str) -> np.ndarray:
    """Rotations (..., 3, 3) of the palm with WebXR's axes of the wrist, found from points (..., 25, 3) alone.

    -Z runs from the wrist to the middle knuckle, +Y leaves the back of the hand. Sources without rotations
    (landmarks in pictures) get them here. Wrist and knuckles must not lie on one line.

    Args:
        points: Joints [m].
        side: "left" or "right", on which the direction of the palm depends.
    """
    wrist = points[..., WRIST, :]
    along = _unit(points[..., KNUCKLES[2], :] - wrist)
    back = np.cross(points[..., KNUCKLES[4], :] - wrist, points[..., KNUCKLES[1], :] - wrist)
    back = back if side == SIDES[1] else -back
    back = _unit(back - (back * along).sum(axis=-1, keepdims=True) * along)
    return np.stack([np.cross(back, -along), back, -along], axis=-1)


def curl(points: np.ndarray) -> np.ndarray:
    """How far (...,) [m] fingers are bent to the side that is the palm's of a right hand, of points (..., 25, 3).

    The mean distance of the four fingers' tips from the plane of the palm. Fingers bend towards the palm alone, so a
    sign below 0 over a stretch of motion says that the hand is a left one; a flat hand says nothing.
    """
    frame = palm_frame(points, SIDES[1])
    reach = points[..., TIPS[1:], :] - points[..., KNUCKLES[1:], :]
    return np.asarray(-np.einsum("...fc,...c->...f", reach, frame[..., 1]).mean(axis=-1))


def mirrored(points: np.ndarray) -> np.ndarray:
    """Hands (..., 25, 3) of the other side: points reflected in the plane x = 0 of their frame."""
    return np.asarray(points * np.array([-1.0, 1.0, 1.0]))


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) of length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
