"""A home position to start from: the hand above a place in front of the base, looking down, and nothing in contact."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from dextera_build.sim.model.imported.hands import Shape, Spot

DRAWN, REFINED, KEPT = 3000, 1500, 40
"""Number of random postures, of small changes of the best one, and of good ones that are tried for contacts."""
FORWARD, HEIGHT, BELOW = 0.5, 0.3, 0.2
"""Wanted place of the palm, in lengths of the arm: ahead of its first joint; above the base; below its first joint."""
_BENT = 0.1
"""Cost of joints that are half a turn from 0 on average, so that of two postures the less turned one is chosen."""
_TURN_M = 0.25
"""Distance [m] that costs as much as a turn of the palm by one radian, per metre of the arm."""


def found(shape: Shape, joints: Sequence[str], palm: Spot, down: int) -> dict[str, float]:
    """Joint of an arm -> position [rad or m]; drawn with a fixed seed.

    Args:
        shape: Geometry of the robot.
        joints: Joints from the base to the palm.
        palm: Frame of the palm.
        down: Column of the palm's axes that points along the fingers.
    """
    if not joints:
        return {}
    limits = np.array([shape.limits(name) for name in joints])
    # A joint that turns more than once needs no more than one turn, and a middle position leaves room to both sides.
    wide = np.ptp(limits, axis=1) > 2 * np.pi
    limits[wide] = np.clip(limits[wide], -np.pi, np.pi)
    search = _Search(shape, joints, palm, down)
    random = np.random.default_rng(0)
    postures = random.uniform(limits[:, 0], limits[:, 1], (DRAWN, len(joints)))
    costs = np.array([search.cost(each) for each in postures])
    starts = postures[np.argsort(costs)[:4]]
    near = starts[random.integers(0, len(starts), REFINED)]
    near = near + random.normal(0, 0.08, near.shape) * np.minimum(np.ptp(limits, axis=1), np.pi)
    near = np.clip(near, limits[:, 0], limits[:, 1])
    both = np.concatenate([postures, near])
    costs = np.concatenate([costs, [search.cost(each) for each in near]])
    best = both[np.argsort(costs)[:KEPT]]
    free = next((each for each in best if not search.touches(each)), best[0])
    return dict(zip(joints, free.tolist(), strict=True))


class _Search:
    """Costs of postures.

    Args:
        shape: Geometry of the robot.
        joints: Joints from the base to the palm.
        palm: Frame of the palm.
        down: Column of its axes that should point down.
    """

    def __init__(self, shape: Shape, joints: Sequence[str], palm: Spot, down: int) -> None:
        self._shape, self._joints, self._palm, self._down = shape, joints, palm, down
        anchors = [shape.data.joint(name).xanchor.copy() for name in joints]
        ends = [*anchors[1:], self._pose()[0]]
        steps = zip(anchors, ends, strict=True)
        self._length = max(sum(float(np.linalg.norm(end - start)) for start, end in steps), 0.1)
        height = max(HEIGHT * self._length, float(anchors[0][2]) - BELOW * self._length)
        self._wanted = np.array([anchors[0][0] + FORWARD * self._length, anchors[0][1], height])
        self._known = self._shape.contacts()

    def cost(self, posture: np.ndarray) -> float:
        """Distance of the palm from the wanted pose, in lengths of the arm."""
        self._shape.place(dict(zip(self._joints, posture.tolist(), strict=True)))
        place, axes = self._pose()
        angle = float(np.arccos(np.clip(-axes[2, self._down], -1, 1)))
        bent = float(np.abs(posture).mean()) / np.pi
        return float(np.linalg.norm(place - self._wanted)) / self._length + _TURN_M * angle + _BENT * bent

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
