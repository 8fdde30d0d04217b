"""Where a page first looks from: an operator's place, from which the robot hides neither its palms nor the object."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment

AWAY_M = 0.85
"""Distance of the eye from what it looks at [m]."""
TOWARDS_OBJECT = 0.6
"""Place of what it looks at on the way from between the palms to the object, 0..1."""
RISES = np.radians([35, 45, 55, 65, 75])
"""Heights of the eye above the horizon, lowest first [rad]."""
BEHIND, AHEAD, BESIDE = np.pi, 0.0, -1.0
"""Directions of the eye about the vertical, from the robot's front: behind two hands, as their owner sees them, or from
the front; one hand is seen obliquely from ahead [rad]."""
SHOWN = 16
"""Number of points of the object that should be seen."""
NEAR_M = 0.12
"""A surface this near to a target is a part of it, or holds it [m]."""


def first(environment: Environment, palms: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """What the page looks at, and the eye, (3,) each in the base [m].

    Args:
        environment: The task, at a start.
        palms: Positions (3,) of the palms that the operator moves, in the base [m].
    """
    base = environment.bundle.base_pose.matrix
    name = environment.task.object
    thing = environment.data.body(name).xpos
    surface = environment.bundle.objects[name].points
    surface = surface[:: max(1, len(surface) // SHOWN)].astype(np.float64)
    middle = np.mean(palms, axis=0)
    look = middle + TOWARDS_OBJECT * (transforms.apply(transforms.invert(base), thing) - middle)
    turned = environment.data.body(name).xmat.reshape(3, 3)
    targets = [*transforms.apply(base, np.asarray(palms)), *(thing + surface @ turned.T)]
    turns = (BEHIND, AHEAD) if len(palms) > 1 else (BESIDE, -BESIDE, BEHIND)
    eyes = [look + AWAY_M * _direction(turn, rise) for turn in turns for rise in RISES]
    hidden = [_hidden(environment, transforms.apply(base, eye), targets) for eye in eyes]
    return look, eyes[int(np.argmin(hidden))]


def _direction(turn: float, rise: float) -> np.ndarray:
    """Unit vector (3,) in the base."""
    return np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])


def _hidden(environment: Environment, eye: np.ndarray, targets: Sequence[np.ndarray]) -> int:
    """Number of targets (3,) that the robot hides from `eye` (3,), in the world [m]."""
    model, data = environment.model, environment.data
    root, geom = model.body(ROBOT + "base").id, np.zeros(1, np.int32)
    found = 0
    for target in targets:
        way = target - eye
        far = float(np.linalg.norm(way))
        met = mujoco.mj_ray(model, data, eye, way / far, None, 1, -1, geom)
        robot = geom[0] >= 0 and model.body_rootid[model.geom_bodyid[geom[0]]] == root
        found += bool(robot and 0.0 <= met < far - NEAR_M)
    return found
