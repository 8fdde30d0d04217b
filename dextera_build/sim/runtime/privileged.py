"""Privileged terms: functions of the simulator's state, only for teachers, critics and rewards.

All quantities, including objects, are in the true frame of the robot's base, see `Start.base_error`; they are not
measurements. Velocities refer to a frame's origin: linear [m/s], then angular [rad/s]. MuJoCo's `qvel` of a free joint
mixes frames (linear in the world, angular in the body), so `mj_objectVelocity` is used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np

from dextera_build.geometry import transforms
from dextera_build.policy.declared import DECLARED
from dextera_build.policy.observation import PrivilegedObservation
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment


class Simulated:
    """The states of one or several worlds of one task, one row each.

    Args:
        environments: The worlds.
    """

    def __init__(self, environments: Sequence[Environment]) -> None:
        self.environments = tuple(environments)
        first = self.environments[0]
        model, bundle = first.model, first.bundle
        self.joints = np.array([model.joint(ROBOT + joint.name).dofadr[0] for joint in bundle.robot.joints])
        """Degrees of freedom of the robot's joints."""
        self.inner = np.array([model.joint(name).dofadr[0] for name in bundle.displacement_names], int)
        """Degrees of freedom of the objects' joints."""
        self.objects = [int(model.body(name).id) for name in bundle.objects]
        """Bodies of the objects."""
        self.object = int(model.body(first.task.object).id)
        """Body of the task's object."""
        self.palms = first.hands.palms
        """Sites of the palms; -1 for a missing one."""
        self.tips = first.hands.tips
        """Sites of the fingertips."""
        self.points = bundle.objects[first.task.object].points.astype(np.float64)
        """Points on the surface of the task's object in its frame (P, 3) [m]."""

    def speeds(self, dofs: np.ndarray) -> np.ndarray:
        """Speeds of degrees of freedom (N, D)."""
        return _stacked([world.data.qvel[dofs] for world in self.environments])

    def body_twists(self, bodies: Sequence[int]) -> np.ndarray:
        """Velocities of bodies in the base (N, B, 6): linear [m/s], angular [rad/s]."""
        return self._twists(mujoco.mjtObj.mjOBJ_XBODY, bodies)

    def site_twists(self, sites: Sequence[int]) -> np.ndarray:
        """Velocities of sites in the base (N, S, 6): linear [m/s], angular [rad/s]; 0 for a missing one."""
        return self._twists(mujoco.mjtObj.mjOBJ_SITE, sites)

    def site_poses(self, sites: Sequence[int]) -> np.ndarray:
        """Poses of sites in the base (N, S, 7)."""
        return _stacked([_site_poses(world, sites) for world in self.environments])

    def palm_poses(self) -> np.ndarray:
        """Poses of the palms in the base (N, L, 7); the identity for a missing one."""
        return _stacked([world.palm_poses() for world in self.environments])

    def contact_forces(self) -> np.ndarray:
        """Force on each fingertip in the base (N, F, 3) [N]."""
        return _stacked([world.contact_forces() for world in self.environments])

    def surfaces(self) -> np.ndarray:
        """The sampled points of the task's object (N, P, 3) [m]; with the joint positions of the photograph."""
        return _stacked([self._surface(world) for world in self.environments])

    def _twists(self, kind: mujoco.mjtObj, numbers: Sequence[int]) -> np.ndarray:
        found = [_twist(world, kind, number) for world in self.environments for number in numbers]
        return np.array(found).reshape(len(self.environments), len(numbers), 6)

    def _surface(self, world: Environment) -> np.ndarray:
        data = world.data
        size = world.start.size_scale.get(world.task.object, 1.0)
        places = size * self.points @ data.xmat[self.object].reshape(3, 3).T + data.xpos[self.object]
        return transforms.apply(world.base_from_world, places)


def contact(worlds: Simulated) -> np.ndarray:
    """Forces on the fingertips (N, F, 3)."""
    return worlds.contact_forces()


def joint_velocities(worlds: Simulated) -> np.ndarray:
    """Speeds of the robot's joints (N, A)."""
    return worlds.speeds(worlds.joints)


def object_velocities(worlds: Simulated) -> np.ndarray:
    """Velocities of the objects (N, O, 6)."""
    return worlds.body_twists(worlds.objects)


def displacement_velocities(worlds: Simulated) -> np.ndarray:
    """Speeds of the objects' joints (N, K)."""
    return worlds.speeds(worlds.inner)


def hand_poses(worlds: Simulated) -> np.ndarray:
    """Poses of the palms (N, L, 7)."""
    return worlds.palm_poses()


def hand_velocities(worlds: Simulated) -> np.ndarray:
    """Velocities of the palms (N, L, 6)."""
    return worlds.site_twists(worlds.palms)


def tip_poses(worlds: Simulated) -> np.ndarray:
    """Poses of the fingertips (N, F, 7)."""
    return worlds.site_poses(worlds.tips)


def tip_velocities(worlds: Simulated) -> np.ndarray:
    """Velocities of the fingertips (N, F, 6)."""
    return worlds.site_twists(worlds.tips)


def points(worlds: Simulated) -> np.ndarray:
    """Points on the task's object (N, P, 3)."""
    return worlds.surfaces()


MEASURES: Mapping[str, Callable[[Simulated], np.ndarray]] = {
    term.name: globals()[term.name] for term in DECLARED if term.seen_by == "critics"
}
"""Privileged term -> its function, which has its name."""


def values(worlds: Simulated) -> dict[str, np.ndarray]:
    """Privileged term -> its values in all worlds (N, ...) float32."""
    return {name: measure(worlds).astype(np.float32) for name, measure in MEASURES.items()}


def privileged(world: Simulated) -> PrivilegedObservation:
    """The privileged observation of a single world."""
    return PrivilegedObservation({name: value[0] for name, value in values(world).items()})


def _twist(world: Environment, kind: mujoco.mjtObj, number: int) -> np.ndarray:
    """Velocity of a frame's origin in the base frame (6,): linear [m/s], angular [rad/s]."""
    twist = np.zeros(6)
    if number < 0:
        return twist
    # Angular first, in axes parallel to the world's. An XBODY is the body's frame, a BODY its centre of mass.
    mujoco.mj_objectVelocity(world.model, world.data, kind, number, twist, 0)
    rotation = world.base_from_world[:3, :3]
    return np.concatenate([rotation @ twist[3:], rotation @ twist[:3]])


def _site_poses(world: Environment, sites: Sequence[int]) -> np.ndarray:
    turns = np.zeros((len(sites), 4))
    for turn, site in zip(turns, sites, strict=True):
        mujoco.mju_mat2Quat(turn, world.data.site_xmat[site])
    return world.poses(world.data.site_xpos[sites], turns)


def _stacked(worlds: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays of worlds along a new first axis; a view if there is a single world, because `np.stack` is slow."""
    return worlds[0][None] if len(worlds) == 1 else np.stack(worlds)
