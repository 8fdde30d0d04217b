"""Progress of an episode, read from the simulator; used only by rewards, never by a policy."""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.control.mechanism import Mechanism
from dextera_build.sim.primitives import articulate, lift
from dextera_build.sim.runtime.environment import Environment

SHARE = 0.95
"""Distance of the push from the axis, see `Mechanism.pushed_at`."""
BEHIND_M = 0.02
"""Distance behind the link's surface from which a fingertip pushes [m]."""
CLEAR_M = 0.06
"""Clearance of a hand from the link's free edge when going around it [m]."""


class Progress:
    """Follows one environment.

    Args:
        environment: The task; each episode is measured against its own start.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._model = environment.model
        frames = environment.bundle.robot.frames
        self._tips = np.array([self._model.site("robot/" + frames[role]).id for role in environment.tips or ("palm",)])
        self._lift = environment.task.primitive == "lift"
        self._points = environment.bundle.objects[environment.task.object].points.astype(np.float64)
        self._links = {} if self._lift else {name: _Link(self._model, name) for name in environment.task.joints}

    def value(self, success: bool) -> float:
        """Value of the current state; see `dextera_build.sim.primitives`."""
        if self._lift:
            return lift.value(self.lifting(success))
        return articulate.value(self.articulating(success))

    def lifting(self, success: bool) -> lift.Progress:
        """Progress of a lift."""
        environment = self._environment
        state, start = environment.state(), environment.judge.start
        local = (self._reached() - state.world_from_object[:3, 3]) @ state.world_from_object[:3, :3]
        reach = np.linalg.norm(local[:, None] - self._points[None], axis=2).min(axis=1).mean()
        rise = float(state.world_from_object[2, 3] - start.world_from_object[2, 3]) / environment.task.height_m
        return lift.Progress(float(reach), state.grasp, rise, success)

    def articulating(self, success: bool) -> articulate.Progress:
        """Progress of an articulation: the joint farthest from its command, and the fingertip nearest to it."""
        environment, data = self._environment, self._environment.data
        start, left, reach = environment.judge.start.joints, 0.0, np.inf
        for name, goal in environment.task.joints.items():
            now = float(data.joint(name).qpos[0])
            share = abs(now - goal) / max(abs(start[name] - goal), environment.task.tolerance, 1e-6)
            if share >= left:
                left = share
                reach = float(self._links[name].distances(data, goal - now, self._reached()).min())
        root = environment.judge.start.world_from_object[:3, 3]
        dragged = float(np.linalg.norm(data.body(environment.task.object).xpos - root))
        return articulate.Progress(reach, left, dragged / articulate.STRAY_M, success)

    def _reached(self) -> np.ndarray:
        return np.asarray(self._environment.data.site_xpos[self._tips])


class _Link:
    """Distance of a hand from pushing a joint's link from behind."""

    def __init__(self, model: mujoco.MjModel, joint: str) -> None:
        self._mechanism = Mechanism(model, joint)
        self._body = int(model.jnt_bodyid[model.joint(joint).id])

    def distances(self, data: mujoco.MjData, way: float, points: np.ndarray) -> np.ndarray:
        """Path lengths (N,) [m] from points (N, 3) to the place where the joint is pushed by `way`, all in the world.

        From the side that the link moves towards, the path leads around its free edge, because the link is in between.
        """
        place, along = self._mechanism.pushed_at(way, SHARE)
        pose = transforms.rigid(data.xmat[self._body].reshape(3, 3), data.xpos[self._body])
        surface, target = transforms.apply(pose, np.stack([place, place - BEHIND_M * along]))
        straight = np.linalg.norm(points - target, axis=1)
        if not self._mechanism.turns:
            return np.asarray(straight)
        arm = place - self._mechanism.pivot
        outwards = np.cross(along, self._mechanism.axis) * np.sign(way)
        outwards *= np.sign(outwards @ arm)
        edge = target + pose[:3, :3] @ outwards * CLEAR_M
        around = np.linalg.norm(points - edge, axis=1) + np.linalg.norm(edge - target)
        before = (points - surface) @ (pose[:3, :3] @ along) > 0
        return np.asarray(np.where(before, around, straight))
