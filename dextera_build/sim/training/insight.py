"""Privileged numbers about worlds, for the critics of policies and for teachers, which run in simulation only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.policy.declared import BY_NAME
from dextera_build.policy.layout import Layout

if TYPE_CHECKING:
    from dextera_build.sim.runtime.environment import Environment

FORCE_N, PLACE_M = 5.0, 0.3
"""Scales of forces [N] and of positions relative to the palm [m]."""
INSIGHT = "insight"
"""Name of these numbers among the inputs of a teacher."""


def insight(
    worlds: Sequence[Environment], limbs: Sequence[str], seen: Mapping[str, np.ndarray], values: Sequence[float]
) -> np.ndarray:
    """Forces, velocities, fingertips and object surface from the palms, time and value, (N, P) float32.

    Args:
        worlds: The N worlds.
        limbs: The limbs that act.
        seen: Privileged term -> its values (N, ...).
        values: Values of their states (N,), whose change is the reward.
    """
    robot, hands, count = worlds[0].bundle.robot, seen["hand_poses"], len(worlds)
    acting = [robot.limb_names.index(limb) for limb in limbs]
    own = [number for number, name in enumerate(robot.limb_names) for _ in robot.limbs[name].tips]
    parts = [
        np.tanh(seen.get("contact", np.zeros((count, 0))) / FORCE_N),
        seen["joint_velocities"],
        seen["object_velocities"],
        (seen.get("tip_poses", np.zeros((count, 0, 7)))[..., :3] - hands[:, own, :3]) / PLACE_M,
        (seen["points"].mean(axis=1)[:, None] - hands[:, acting, :3]) / PLACE_M,
        np.array([[each.steps * each.period_s / each.task.timeout_s] for each in worlds]),
        np.array(values)[:, None],
    ]
    numbers = np.concatenate([part.reshape(count, -1) for part in parts], axis=1)
    return np.asarray(np.clip(numbers, -5.0, 5.0), np.float32)


def size(layout: Layout, limbs: int) -> int:
    """P, the number of these numbers in a task, for a number of limbs that act."""
    terms = ("contact", "joint_velocities", "object_velocities")
    tips = layout.shape(BY_NAME["tip_poses"])[0]
    return sum(int(np.prod(layout.shape(BY_NAME[name]))) for name in terms) + 3 * tips + 3 * limbs + 2
