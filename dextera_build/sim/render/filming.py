"""Recorded steps as states of the task's model, without simulation."""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model import model as models
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.robot_base import RobotBase
from dextera_build.sim.model.sizes import Sizes


class Replica:
    """Converts recorded steps to positions of a task's compiled model.

    Args:
        bundle: The task of the episodes.
        episodes: Defines the joints and bodies of its episodes' arrays.

    Raises:
        RuleError: MuJoCo cannot load the model, or it lacks a joint or body of the episodes.
    """

    def __init__(self, bundle: TaskBundle, episodes: Episodes) -> None:
        self.model = models.compile_folder(bundle.model)
        self.data = models.at_home(self.model)
        self._sizes = Sizes(bundle.objects, self.model)
        self._base = bundle.base_pose.matrix
        self._joints = self._addresses([ROBOT + name for name in episodes.joint_names])
        self._followers = [
            (address, episodes.joint_names.index(each.leader), each)
            for each in bundle.robot.followers
            if each.leader in episodes.joint_names
            for address in self._addresses([ROBOT + each.name])
        ]
        self._displacements = self._addresses(list(episodes.displacement_names))
        self._objects = self._addresses(list(episodes.object_names))
        self._robot_base = RobotBase(self._base, self.model)

    def positions(self, episode: Episode) -> np.ndarray:
        """MuJoCo positions (T, Q) of every step; unrecorded positions keep their initial values.

        Followers are set from their leaders. The model's objects get the sizes of this episode, and its robot the base
        pose of the episode; objects were recorded in the bundle's base frame.

        Raises:
            RuleError: The episode's start belongs to another model.
        """
        if len(episode.start.qpos) != self.model.nq:
            raise RuleError(
                "the episodes were not made in this task's model",
                code="DXB-B230",
                facts={"positions of the start": len(episode.start.qpos), "of the model": self.model.nq},
                hint="give the bundle that the episodes were made in",
            )
        self._sizes.put(episode.start.size_scale)
        self._robot_base.put(self.model, episode.start.base_error)
        found = np.tile(episode.start.qpos, (len(episode.joints), 1))
        found[:, self._joints] = episode.joints
        for address, leader, each in self._followers:
            found[:, address] = each.ratio * episode.joints[:, leader] + each.offset
        found[:, self._displacements] = episode.displacement
        for number, address in enumerate(self._objects):
            found[:, address : address + 7] = in_world(self._base, episode.objects[:, number])
        return found

    def show(self, positions: np.ndarray) -> None:
        """Move the bodies of `data` to `positions` (Q,)."""
        self.data.qpos[:] = positions
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def _addresses(self, names: list[str]) -> np.ndarray:
        known = {self.model.joint(number).name: number for number in range(self.model.njnt)}
        missing = [name for name in names if name not in known]
        if missing:
            raise RuleError(
                f"the task's model has no joint `{missing[0]}`",
                code="DXB-B231",
                facts={"joints": listing(sorted(known), most=40)},
                hint="give the bundle that the episodes were made in",
            )
        return np.array([self.model.jnt_qposadr[known[name]] for name in names], int)


def in_world(world_from_base: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Transform poses (T, 7), position [m] and quaternion w x y z, from the base frame to the world frame."""
    turn = quaternions.from_matrix(world_from_base[:3, :3])
    found = np.empty(poses.shape)
    found[:, :3] = transforms.apply(world_from_base, poses[:, :3].astype(np.float64))
    found[:, 3:] = quaternions.multiply(turn, poses[:, 3:].astype(np.float64))
    return found
