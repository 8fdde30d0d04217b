"""Fingers that overpower the thumb press less: together no more than it can hold.

A demonstration closes all fingers as far as they go, so that each motor presses with its whole torque. Two fingers then
push the thumb back, faster than its own motor turns, until it is at its stop; or a finger that the object does not stop
pushes into the thumb.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dextera_build.sim.experts.sources import Source
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment


def overpowered(sources: Sequence[Source], environment: Environment, most: float) -> bool:
    """Whether a joint was faster than `most` times its limit in a demonstration: something stronger pushed it."""
    speeds = np.array([joint.velocity for joint in environment.bundle.robot.joints])
    return any(each.fastest(speeds, environment.task.control_hz) > most for each in sources)


def softened(source: Source, environment: Environment, gain_scale: float) -> Source:
    """The demonstration with targets of fingers that lie less deep in what stops them; thumb and arm are left alone.

    A position actuator presses with its stiffness times the distance from its target, up to its effort. Of n fingers
    that reach their effort, each may press with 1 / n of it.

    Args:
        source: A demonstration.
        environment: Its task; begun.
        gain_scale: Factor on the stiffness of the actuators in the start that it has begun.
    """
    robot, model = environment.bundle.robot, environment.model
    names = [joint.name for joint in robot.joints]
    gains = np.array([model.actuator_gainprm[model.actuator(ROBOT + name).id, 0] for name in names]) / gain_scale
    full = np.array([joint.effort for joint in robot.joints]) / gains
    shown = source.episode
    beyond = shown.action.astype(np.float64) - shown.joints
    for limb in robot.limbs.values():
        if limb.thumb is not None and limb.gripper is None:
            fingers = [_driven(environment, role, limb.hand) for role in limb.fingers]
            beyond = eased(beyond, [[names.index(name) for name in finger] for finger in fingers], full)
    action = (shown.joints + beyond).astype(shown.action.dtype)
    return replace(source, episode=shown.model_copy(update={"action": action}))


def eased(beyond: np.ndarray, fingers: Sequence[Sequence[int]], full: np.ndarray) -> np.ndarray:
    """Distances of targets from joints (T, A), shorter for fingers that press with their whole effort.

    Args:
        beyond: Distances of targets from joints (T, A) [rad].
        fingers: Columns of the joints of each finger opposite the thumb.
        full: Distances at which actuators reach their effort (A,) [rad].
    """
    found = beyond.copy()
    pressing = [list(each) for each in fingers if (np.abs(beyond[:, list(each)]) >= full[list(each)]).any()]
    for each in pressing:
        most = full[each] / len(pressing)
        found[:, each] = np.clip(beyond[:, each], -most, most)
    return found


def _driven(environment: Environment, role: str, hand: tuple[str, ...]) -> list[str]:
    """Joints of the hand between the palm and a fingertip."""
    model = environment.model
    body = int(model.site(ROBOT + environment.bundle.robot.frames[role]).bodyid[0])
    found: list[str] = []
    while body:
        moving = np.flatnonzero(model.jnt_bodyid == body).tolist()
        joints = [model.joint(number).name.removeprefix(ROBOT) for number in moving]
        found += [name for name in joints if name in hand]
        body = int(model.body_parentid[body])
    return found
