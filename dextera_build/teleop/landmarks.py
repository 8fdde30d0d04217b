"""Hands from MediaPipe's landmarks: 25 joints in space of 21 points in a picture.

MediaPipe gives each landmark in the picture [pixel], and in space relative to the middle of the hand [m], of a hand of
usual size. The second is scaled to the operator's hand; then the palm's landmarks in the picture say where it is, by a
perspective with the stated angle of view. Its distance follows from its size in the picture alone: it is wrong by the
same share as the stated length of the hand and the focal length, and by one part in the palm's width in pixels for each
pixel of the landmarks. Motion along the picture is far more exact.

Inferred, as no landmark shows it: the metacarpals of the four fingers, on the lines from the wrist to the knuckles with
the proportions of `human_hand`; and all rotations. That of the wrist is `hands.palm_frame`, and the axes of a bone are
those of the bone before, turned by the least angle.

Axes of the camera: x right in the picture, y down, z away from it. The operator looks at the camera, so that those of
WebXR (x right, y up, -z ahead) are (-x, -y, z).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, TRACKED
from dextera_build.geometry import hands, human_hand, lie, quaternions
from dextera_build.sim.experts.live_operator import Message
from dextera_build.sim.retarget.low_pass import LowPass
from dextera_build.teleop.protocol import AHEAD

PALM = (0, 5, 9, 13, 17)
"""Landmarks of the wrist and of the four knuckles, which move with the palm."""
SURE_PX = 8.0
"""Error of landmarks that weighs as much as a radian between MediaPipe's own rotation and the found one [pixel]."""
ROUNDS = 8
"""Gauss-Newton steps of the palm's pose."""
DEPTH_HZ, SIDEWAYS_HZ = 2.0, 6.0
"""Low pass of the distance from the camera, which is the noisiest, and of the directions in which the hand is seen."""
DOUBT = 0.8
"""Below this, MediaPipe's left or right is not believed against that of the last picture."""
LITTLE_M, AWAY_M = 0.028, 0.05
"""The thumb at the little finger, and away from the index finger, opens the clutch; its landmarks are less exact than a
headset's [m]."""
FACING = np.diag([-1.0, -1.0, 1.0])
"""Rotation of the camera's axes into WebXR's."""


@dataclass
class Landmarks:
    """Messages of a live session from landmarks, picture by picture.

    Args:
        width: Of the pictures [pixel].
        height: Of the pictures [pixel].
        view_rad: Angle of view across the picture [rad].
        length_m: Of the operator's hand, from the wrist's crease to the tip of the middle finger [m].
    """

    width: int
    height: int
    view_rad: float
    length_m: float
    _number: int = 0
    _last: str = ""
    _depths: tuple[LowPass, LowPass] = field(default_factory=lambda: (LowPass(DEPTH_HZ), LowPass(DEPTH_HZ)))
    _rays: tuple[LowPass, LowPass] = field(default_factory=lambda: (LowPass(SIDEWAYS_HZ), LowPass(SIDEWAYS_HZ)))
    _seen: list[float] = field(default_factory=lambda: [np.nan, np.nan])

    @property
    def focal_px(self) -> float:
        """Focal length [pixel]."""
        return 0.5 * self.width / float(np.tan(0.5 * self.view_rad))

    def message(self, found: list[dict[str, Any]], seen: float, arrived: float, heading_rad: float) -> Message:
        """The hands of a picture, in the robot's base.

        Args:
            found: Hands as `landmark_program` prints them.
            seen: When the picture was taken [s].
            arrived: When its hands came, by `time.perf_counter` [s].
            heading_rad: Angle about the vertical from the operator's axes to those of the base [rad].
        """
        self._number += 1
        turn = lie.about_z(heading_rad) @ AHEAD @ FACING
        places, rotations = np.full((2, 25, 3), np.nan), np.full((2, 25, 4), np.nan)
        tracking, clutch, pinch = np.full(2, LOST, np.uint8), np.zeros(2, bool), np.zeros(2)
        for side, one in self._sided(found).items():
            hand = hands.SIDES.index(side)
            points = self._placed(hand, np.array(one["image"]), np.array(one["world"]), seen)
            frames = turn @ rotations_of(points, side)
            places[hand], rotations[hand] = points @ turn.T, quaternions.from_matrices(frames)
            tracking[hand], clutch[hand], pinch[hand] = TRACKED, not _opens(points), hands.pinch(points)
        head = np.full(7, np.nan, np.float32)
        points, turns, closed = (each.astype(np.float32) for each in (places, rotations, pinch))
        return Message(self._number, arrived, points, turns, tracking, clutch, closed, head)

    def _sided(self, found: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """Side -> its hand, the surest first; a single hand of a doubtful side keeps that of the last picture."""
        if len(found) == 1 and found[0]["sure"] < DOUBT and self._last:
            found = [found[0] | {"side": self._last}]
        kept = {one["side"]: one for one in sorted(found, key=lambda one: float(one["sure"]))}
        self._last = next(iter(kept)) if len(kept) == 1 else ""
        return kept

    def _placed(self, hand: int, image: np.ndarray, world: np.ndarray, seen: float) -> np.ndarray:
        """Joints (25, 3) in the axes of the camera [m], with the place of the hand smoothed."""
        points = shaped(world, self.length_m)
        pixels = image[list(PALM)] - [0.5 * self.width, 0.5 * self.height]
        turn, place = pose(points[[hands.MEDIAPIPE[each] for each in PALM]], pixels / self.focal_px, self.focal_px)
        gap, self._seen[hand] = seen - self._seen[hand], seen
        if not 0 < gap < 0.5:
            self._depths[hand].begin(place[2:])
            self._rays[hand].begin(place[:2] / place[2])
            gap = 0.0
        depth = float(self._depths[hand].next(place[2:], gap)[0])
        ray = self._rays[hand].next(place[:2] / place[2], gap)
        return np.asarray(points @ turn.T + depth * np.append(ray, 1.0))


def shaped(world: np.ndarray, length_m: float) -> np.ndarray:
    """Joints (25, 3) of a hand with landmarks (21, 3) in space, of a length [m], about their own middle."""
    points = np.full((25, 3), np.nan)
    points[list(hands.MEDIAPIPE)] = world
    along = np.array(human_hand.KNUCKLE_ALONG)
    shares = human_hand.BASE_ALONG / (human_hand.BASE_ALONG + along)
    bases, knuckles = [chain[0] for chain in hands.CHAINS[1:]], points[list(hands.KNUCKLES[1:])]
    points[bases] = points[0] + shares[:, None] * (knuckles - points[0])
    model, _ = human_hand.Hand(length_m).joints(human_hand.open_angles(), hands.SIDES[1])
    return np.asarray(points * hands.hand_size(model) / hands.hand_size(points))


def pose(points: np.ndarray, seen: np.ndarray, focal_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and place (3,) [m] that bring points (P, 3) to where they are seen, by least squares.

    Args:
        points: In nearly the right orientation [m].
        seen: (P, 2) x / z and y / z in the axes of the camera.
        focal_px: Focal length, for the weight of the orientation [pixel].
    """
    spread = [np.linalg.norm(each - each.mean(axis=0), axis=1).mean() for each in (points[:, :2], seen)]
    depth = spread[0] / max(spread[1], 1e-6)
    turn, place = np.eye(3), np.append(depth * seen.mean(axis=0), depth) - points.mean(axis=0)
    twist, weight = np.zeros(3), SURE_PX / focal_px
    for _ in range(ROUNDS):
        moved = points @ turn.T
        x, y, z = (moved + place).T
        rows = np.zeros((len(points), 2, 3))
        rows[:, 0, 0] = rows[:, 1, 1] = 1 / z
        rows[:, 0, 2], rows[:, 1, 2] = -x / z**2, -y / z**2
        # Of a small turn w, moved points move by w x moved.
        turned = np.stack([np.cross(axis, moved) for axis in np.eye(3)], axis=-1)
        jacobian = np.concatenate([np.concatenate([rows @ turned, rows], axis=2).reshape(-1, 6), np.eye(3, 6) * weight])
        missed = np.concatenate([(seen - np.stack([x / z, y / z], axis=1)).ravel(), -weight * twist])
        step = np.linalg.lstsq(jacobian, missed, rcond=None)[0]
        turn, place = lie.rotation(step[:3]) @ turn, place + step[3:]
        twist = lie.rotation_vector(turn)
        place[2] = max(place[2], 0.05)
    return turn, place


def rotations_of(points: np.ndarray, side: str) -> np.ndarray:
    """Rotations (25, 3, 3) with WebXR's axes of joints (25, 3) of a hand."""
    found = np.empty((25, 3, 3))
    found[hands.WRIST] = hands.palm_frame(points, side)
    for chain in hands.CHAINS:
        last = found[hands.WRIST]
        for joint, after in zip(chain, (*chain[1:], chain[-1]), strict=True):
            bone = points[after] - points[joint]
            last = last if joint == after else _least(-last[:, 2], bone / np.linalg.norm(bone)) @ last
            found[joint] = last
    return found


def _least(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) of one direction into another."""
    axis = np.cross(one, other)
    sine = float(np.linalg.norm(axis))
    return lie.rotation(axis / max(sine, 1e-12) * np.arctan2(sine, one @ other))


def _opens(points: np.ndarray) -> bool:
    """Whether a hand opens the clutch."""
    return bool(hands.pinch_distance(points, "pinky") < LITTLE_M and hands.pinch_distance(points) > AWAY_M)
