"""A home position to start from: the hand above a place in front of the base, looking down, and nothing in contact."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from dextera_build.sim.model.imported.hands import Shape, Spot

DRAWN, KEPT = 3000, 400
"""Number of random postures, and of good ones that are tried for contacts."""
WIDTHS_RAD, BEST, CHANGED = (0.4, 0.25, 0.15, 0.08, 0.04), 12, 300
"""Standard deviations of changes of the best postures, round by round; numbers of those, and of changes in a round."""
FORWARD, HEIGHT, BELOW = 0.45, 0.3, 0.2
"""Wanted place of the palm, in lengths of the arm: ahead of its first joint; above the base; below its first joint."""
_BENT, _TIGHT, FREE_RAD = 0.3, 0.3, 0.4
"""Cost of joints that are half a turn from 0 (root mean square), so that of two postures the less turned one is chosen;
cost of a joint at its limit, and the distance from it at which that ends [rad, of sliding joints m]."""
_ASIDE = 0.01
"""Cost of a front of the base against its x axis."""
_LOW, RAISED = 2.0, 0.25
"""Cost of an elbow or wrist below the palm by the length of the arm, because it would touch the table first, and of the
highest one that is not above the palm by this part of the length."""
_TURN_M = 0.25
"""Distance [m] that costs as much as a turn of the palm by one radian, per metre of the arm."""


def found(shape: Shape, joints: Sequence[str], palm: Spot, down: int, alone: bool = False) -> dict[str, float]:
    """Joint of an arm -> position [rad or m]; drawn with a fixed seed.

    Args:
        shape: Geometry of the robot.
        joints: Joints from the base to the palm.
        palm: Frame of the palm.
        down: Column of the palm's axes that points along the fingers.
        alone: The robot has no other arm, so that its front is where the arm points with its joints in the middle.
    """
    if not joints:
        return {}
    limits = np.array([shape.limits(name) for name in joints])
    # A joint that turns more than once needs no more than one turn, and a middle position leaves room to both sides.
    wide = np.ptp(limits, axis=1) > 2 * np.pi
    limits[wide] = np.clip(limits[wide], -np.pi, np.pi)
    search = _Search(shape, joints, palm, down, limits, alone)
    random = np.random.default_rng(0)
    postures = random.uniform(limits[:, 0], limits[:, 1], (DRAWN, len(joints)))
    costs = np.array([search.cost(each) for each in postures])
    for width in WIDTHS_RAD:
        starts = postures[np.argsort(costs)[:BEST]][random.integers(0, BEST, CHANGED)]
        near = starts + random.normal(0, width, starts.shape) * np.minimum(np.ptp(limits, axis=1) / np.pi, 1.0)
        near = np.clip(near, limits[:, 0], limits[:, 1])
        postures = np.concatenate([postures, near])
        costs = np.concatenate([costs, [search.cost(each) for each in near]])
    best = postures[np.argsort(costs)[:KEPT]]
    free = next((each for each in best if not search.touches(each)), best[0])
    return dict(zip(joints, free.tolist(), strict=True))


class _Search:
    """Costs of postures.

    Args:
        shape: Geometry of the robot.
        joints: Joints from the base to the palm.
        palm: Frame of the palm.
        down: Column of its axes that should point down.
        limits: Limits (A, 2) of the joints [rad or m].
        alone: Any direction from the base may be ahead.
    """

    def __init__(
        self, shape: Shape, joints: Sequence[str], palm: Spot, down: int, limits: np.ndarray, alone: bool
    ) -> None:
        self._alone = alone
        self._shape, self._joints, self._palm, self._down = shape, joints, palm, down
        self._limits, self._free = limits, np.minimum(FREE_RAD, np.ptp(limits, axis=1) / 4)
        anchors = [shape.data.joint(name).xanchor.copy() for name in joints]
        ends = [*anchors[1:], self._pose()[0]]
        steps = zip(anchors, ends, strict=True)
        self._length = max(sum(float(np.linalg.norm(end - start)) for start, end in steps), 0.1)
        height = max(HEIGHT * self._length, float(anchors[0][2]) - BELOW * self._length)
        self._first, self._far, self._height = anchors[0][:2], FORWARD * self._length, height
        self._known = self._shape.contacts()

    def cost(self, posture: np.ndarray) -> float:
        """Distance of the palm from the wanted pose, in lengths of the arm."""
        self._shape.place(dict(zip(self._joints, posture.tolist(), strict=True)))
        place, axes = self._pose()
        angle = float(np.arccos(np.clip(-axes[2, self._down], -1, 1)))
        bent = float(np.sqrt(np.mean(posture**2))) / np.pi
        room = np.minimum(posture - self._limits[:, 0], self._limits[:, 1] - posture)
        tight = float(np.clip(1.0 - room / self._free, 0.0, 1.0).max())
        x, y = place[:2] - self._first
        side = float(np.arctan2(y, x))
        missed = [np.hypot(x, y) - self._far, 0.0] if self._alone else [x - self._far, y]
        away = float(np.linalg.norm([*missed, place[2] - self._height])) / self._length
        away += _ASIDE * abs(side) / np.pi if self._alone else 0.0
        if len(self._joints) > 2:
            heights = [float(self._shape.data.joint(name).xanchor[2]) - float(place[2]) for name in self._joints[2:]]
            away += _LOW * max(0.0, -min(heights), RAISED * self._length - max(heights)) / self._length
        return away + _TURN_M * angle + _BENT * bent + _TIGHT * tight

    def touches(self, posture: np.ndarray) -> bool:
        """Whether links touch that do not touch with all joints at 0: neighbours do in many files."""
        self._shape.place(dict(zip(self._joints, posture.tolist(), strict=True)))
        return bool(self._shape.contacts() - self._known)

    def _pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and axes (3, 3) of the palm in the world."""
        link = self._shape.data.body(self._palm.link if self._palm.link != "base" else 1)
        turn, own = link.xmat.reshape(3, 3), np.zeros(9)
        mujoco.mju_quat2Mat(own, self._palm.turn)
        return link.xpos + turn @ self._palm.at, turn @ own.reshape(3, 3)
