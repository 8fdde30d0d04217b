"""Privileged quantities from the simulator's state, only for teachers, critics and rewards.

All quantities, including objects, are in the true frame of the robot's base, see `Start.base_error`; they are not
measurements. Velocities refer to a frame's origin: linear [m/s], then angular [rad/s]. MuJoCo's `qvel` of a free joint
mixes frames (linear in the world, angular in the body), so `mj_objectVelocity` is used.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.geometry import transforms
from dextera_build.policy.observation import PrivilegedObservation
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment


class Insight:
    """Reads one environment.

    Args:
        environment: Any task.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        model, bundle = environment.model, environment.bundle
        self._dofs = np.array([model.joint(ROBOT + joint.name).dofadr[0] for joint in bundle.robot.joints])
        self._inner = np.array([model.joint(name).dofadr[0] for name in bundle.displacement_names], int)
        self._bodies = [int(model.body(name).id) for name in bundle.objects]
        self._palms = environment.hands.palms
        self._tips = environment.hands.tips
        self._points = bundle.objects[environment.task.object].points.astype(np.float64)

    def read(self) -> PrivilegedObservation:
        """Read all current quantities."""
        environment = self._environment
        data = environment.data
        sites = [self._velocity(mujoco.mjtObj.mjOBJ_SITE, site) for site in self._tips]
        bodies = [self._velocity(mujoco.mjtObj.mjOBJ_XBODY, body) for body in self._bodies]
        palms = [self._velocity(mujoco.mjtObj.mjOBJ_SITE, site) if site >= 0 else np.zeros(6) for site in self._palms]
        return PrivilegedObservation(
            contact=environment.contact_forces().astype(np.float32),
            joint_velocities=data.qvel[self._dofs].astype(np.float32),
            object_velocities=np.array(bodies, np.float32).reshape(-1, 6),
            displacement_velocities=data.qvel[self._inner].astype(np.float32),
            hand_poses=environment.palm_poses().astype(np.float32),
            hand_velocities=np.array(palms, np.float32).reshape(-1, 6),
            tip_poses=self._tip_poses(data).astype(np.float32),
            tip_velocities=np.array(sites, np.float32).reshape(-1, 6),
            points=self._surface(data).astype(np.float32),
        )

    def _velocity(self, kind: Any, number: int) -> np.ndarray:
        """Velocity of a frame's origin in the base frame (6,): linear [m/s], angular [rad/s]."""
        environment = self._environment
        twist = np.zeros(6)
        # Angular first, in axes parallel to the world's. An XBODY is the body's frame, a BODY its centre of mass.
        mujoco.mj_objectVelocity(environment.model, environment.data, kind, number, twist, 0)
        rotation = environment.base_from_world[:3, :3]
        return np.concatenate([rotation @ twist[3:], rotation @ twist[:3]])

    def _tip_poses(self, data: Any) -> np.ndarray:
        turns = np.zeros((len(self._tips), 4))
        for turn, site in zip(turns, self._tips, strict=True):
            mujoco.mju_mat2Quat(turn, data.site_xmat[site])
        return self._environment.poses(data.site_xpos[self._tips], turns)

    def _surface(self, data: Any) -> np.ndarray:
        """The sampled points of the task's object (P, 3) [m]; with the joint positions of the photograph."""
        body = int(self._environment.model.body(self._environment.task.object).id)
        size = self._environment.start.size_scale.get(self._environment.task.object, 1.0)
        world = size * self._points @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
        return transforms.apply(self._environment.base_from_world, world)
