"""An articulated human hand: lengths by proportions of the hand, and the poses of its 25 joints by angles.

Lengths of bones and places of the knuckles are fractions of the hand's length and breadth from Buchholz, Armstrong and
Goldstein, Anthropometric data for describing the kinematics of the human hand, Ergonomics 35 (1992), and ratios of the
proximal to the middle phalanges from An et al. (1979); both are taken as the sources of a public hand model quote them,
not from the papers. Assumptions of this module, without a source: the hand's default length and breadth, the direction
of the thumb's metacarpal at angle 0, fingers that are parallel at angle 0, rigid metacarpals of the four fingers, no
arch of the palm, and the coupling of the last two joints of a finger.

Frames are those of `geometry.hands`; everything is in the frame of the wrist [m, rad].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import hands

BASE_ALONG, BASE_ACROSS = 0.073, (0.196, 0.126, 0.0, -0.129, -0.223)
"""Bases of the metacarpals: fraction of the length beyond the wrist; of the breadth to the thumb's side."""
KNUCKLE_ALONG, KNUCKLE_ACROSS = (0.374, 0.373, 0.336, 0.295), (0.126, 0.0, -0.077, -0.179)
"""Knuckles of the four fingers from the bases of their metacarpals, as fractions of length and breadth."""
_MIDDLE = (0.143, 0.170, 0.165, 0.117)
_RATIOS = ((1.94 + 0.45) / 1.29, (1.62 + 0.37) / 1.22, (1.56 + 0.34) / 1.21, (1.78 + 0.49) / 1.29)
_DISTAL = (0.097, 0.108, 0.107, 0.093)
PHALANGES = tuple(
    (ratio * middle, middle, distal) for ratio, middle, distal in zip(_RATIOS, _MIDDLE, _DISTAL, strict=True)
)
"""Proximal, middle and distal phalanx of each of the four fingers, as fractions of the length."""
THUMB = (0.251, 0.196, 0.158)
"""Metacarpal, proximal and distal phalanx of the thumb, as fractions of the length."""
COUPLED = 2 / 3
"""Angle of a finger's last joint per angle of its middle joint."""
LIMITS_DEG = np.array([[(-30, 60), (-25, 35), (-10, 80), (-15, 80)], *[[(-20, 20), (-20, 90), (0, 100), (0, 67)]] * 4])
"""Limits (5, 4, 2) of the angles [deg]; see `joints`. The sideways limits of the four fingers are an assumption."""
_AHEAD, _PAD = (-0.55, -0.40, -0.73), (0.80, -0.55, -0.25)
"""Of a right thumb at angle 0: direction of its metacarpal, and direction out of its pad."""


@dataclass(frozen=True)
class Hand:
    """A hand of a size.

    Args:
        length_m: From the wrist's crease to the tip of the middle finger [m].
        breadth_m: Across the knuckles [m].
    """

    length_m: float = 0.19
    breadth_m: float = 0.085

    def joints(self, angles: np.ndarray, side: str) -> tuple[np.ndarray, np.ndarray]:
        """Positions (..., 25, 3) [m] and rotations (..., 25, 3, 3) of the joints in the frame of the wrist.

        Args:
            angles: (..., 5, 4) per finger [rad]. Four fingers: turn of the knuckle to the thumb's side, bend of the
                knuckle, of the middle joint, of the last joint. Thumb: turn and bend of its base, bend of the knuckle,
                of the last joint. A bend is towards the pad.
            side: "left" or "right".
        """
        lead = angles.shape[:-2]
        places = np.zeros((*lead, len(hands.JOINTS), 3))
        turns = np.broadcast_to(np.eye(3), (*lead, len(hands.JOINTS), 3, 3)).copy()
        self._thumb(angles[..., 0, :], places, turns)
        for finger in range(1, len(hands.FINGERS)):
            self._finger(finger, angles[..., finger, :], places, turns)
        if side == hands.SIDES[0]:
            flip = np.diag([-1.0, 1.0, 1.0])
            return hands.mirrored(places), flip @ turns @ flip
        return places, turns

    def _base(self, finger: int) -> np.ndarray:
        return np.array([-BASE_ACROSS[finger] * self.breadth_m, 0.0, -BASE_ALONG * self.length_m])

    def _thumb(self, angles: np.ndarray, places: np.ndarray, turns: np.ndarray) -> None:
        base, knuckle, last, tip = hands.CHAINS[0]
        frame = _thumb_frame() @ _turn(1, angles[..., 0]) @ _turn(0, -angles[..., 1])
        places[..., base, :], turns[..., base, :, :] = self._base(0), frame
        for joint, after, length, bend in (
            (base, knuckle, THUMB[0], angles[..., 2]),
            (knuckle, last, THUMB[1], angles[..., 3]),
            (last, tip, THUMB[2], np.zeros_like(angles[..., 0])),
        ):
            _extend(places, turns, joint, after, length * self.length_m, bend)

    def _finger(self, finger: int, angles: np.ndarray, places: np.ndarray, turns: np.ndarray) -> None:
        base, knuckle, middle, last, tip = hands.CHAINS[finger]
        across = -KNUCKLE_ACROSS[finger - 1] * self.breadth_m
        along = KNUCKLE_ALONG[finger - 1] * self.length_m
        places[..., base, :] = self._base(finger)
        turns[..., base, :, :] = _turn(1, np.array(math.atan2(-across, along)))
        places[..., knuckle, :] = self._base(finger) + np.array([across, 0.0, -along])
        turns[..., knuckle, :, :] = _turn(1, angles[..., 0]) @ _turn(0, -angles[..., 1])
        for joint, after, length, bend in zip(
            (knuckle, middle, last),
            (middle, last, tip),
            PHALANGES[finger - 1],
            (angles[..., 2], angles[..., 3], np.zeros_like(angles[..., 0])),
            strict=True,
        ):
            _extend(places, turns, joint, after, length * self.length_m, bend)


def open_angles() -> np.ndarray:
    """Angles (5, 4) of an open, relaxed hand [rad]; an assumption."""
    return np.deg2rad([[0, 0, 10, 5], [6, 8, 8, 5], [0, 8, 8, 5], [-5, 8, 8, 5], [-10, 8, 8, 5]])


def _extend(places: np.ndarray, turns: np.ndarray, joint: int, after: int, length_m: float, bend: np.ndarray) -> None:
    """Place the joint at the end of a bone, bent against it."""
    places[..., after, :] = places[..., joint, :] - length_m * turns[..., joint, :, 2]
    turns[..., after, :, :] = turns[..., joint, :, :] @ _turn(0, -bend)


def _thumb_frame() -> np.ndarray:
    """Frame (3, 3) of a right thumb's metacarpal at angle 0."""
    back = -np.array(_AHEAD) / np.linalg.norm(_AHEAD)
    up = -np.array(_PAD)
    up -= (up @ back) * back
    up /= np.linalg.norm(up)
    return np.stack([np.cross(up, back), up, back], axis=1)


def _turn(axis: int, angles: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) about the x (0), y (1) or z (2) axis."""
    found = np.broadcast_to(np.eye(3), (*angles.shape, 3, 3)).copy()
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angles), np.sin(angles)
    found[..., first, first] = found[..., second, second] = cosine
    found[..., first, second], found[..., second, first] = -sine, sine
    return found
