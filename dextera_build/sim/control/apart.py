"""Distances that arms keep from the rest of their robot, by mink's limit on the speed at which parts approach."""

from __future__ import annotations

from typing import Any

import mink
import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel

NEAR_M = 0.05
"""Distance beyond the one that is kept, from which on parts slow down [m]."""
SLACK_M = 0.002
"""How much nearer than wanted a step may bring parts, because it is planned on straight lines [m]."""
SHARES = (0.5, 0.25)
"""Parts of a step that brings parts too near, tried in turn; the arms stay if none fits."""
MET = 1e-9
"""Rest of the room of a step that counts as none [m]."""


class Apart:
    """Pairs of a robot's parts, of which arms move one or both, that stay apart.

    Parts of hands are left out in pairs, because hands meet in tasks, and fingers of a model of arms do not move. So
    are neighbours, pairs whose collision the robot's model excludes, and those that are nearer than `apart_m` at home.

    Args:
        robot: The embodiment.
        model: Its compiled model with the joints of arms alone, `fixed_joints.alone`.
        apart_m: Distance that is kept [m].
    """

    def __init__(self, robot: RobotModel, model: Any, apart_m: float) -> None:
        self._model, self._apart_m = model, apart_m
        hand = {model.body(name).id for name, group in robot.links.items() if group == "hand"}
        pairs = _pairs(robot, model, hand, apart_m)
        self.limit = mink.CollisionAvoidanceLimit(
            model,
            [([one], [other]) for one, other in pairs],
            minimum_distance_from_collisions=apart_m,
            collision_detection_distance=apart_m + NEAR_M,
        )
        """The limit, for `mink.solve_ik`."""
        self._pairs = np.array(self.limit.geom_id_pairs, int).reshape(-1, 2)
        self._reach = model.geom_rbound[self._pairs].sum(axis=1) + apart_m
        self.rows, self.room = np.zeros((0, model.nv)), np.zeros(0)
        """(K, V) and (K,): a displacement x of the next step fits if `rows` x <= `room` [m]."""
        self._near = np.zeros(0, int)
        self.met: list[tuple[str, str]] = []
        """Links that the last step brought as near as they may come, as pairs."""

    def begin(self, state: mink.Configuration) -> None:
        """Find the pairs that are near, and their room, before a control step."""
        found = self.limit.compute_qp_inequalities(state, 1.0)
        assert found.G is not None
        assert found.h is not None
        self._near = np.flatnonzero(np.isfinite(found.h))
        self.rows, self.room, self.met = found.G[self._near], found.h[self._near], []

    def spend(self, displacement: np.ndarray) -> None:
        """Take note of a displacement (V,), a part of the step."""
        self.room = self.room - self.rows @ displacement
        bodies = self._model.geom_bodyid[self._pairs[self._near[self.room < MET]]]
        names = {(self._model.body(one).name, self._model.body(other).name) for one, other in bodies.tolist()}
        self.met = sorted(names | set(self.met))

    def end(self, state: mink.Configuration, start: np.ndarray) -> None:
        """Shorten the step from joints `start` (V,) to those of `state`, if it brings parts too near.

        The room is that of straight lines, and fast joints may pass what was not near yet.
        """
        wanted, enough = state.q.copy(), self._apart_m - SLACK_M
        if self._nearest(state) >= enough:
            return
        state.update(start)
        if self._nearest(state) < enough:
            # It was too near before, and the room alone says where it may go.
            state.update(wanted)
            return
        for share in SHARES:
            state.update(start + share * (wanted - start))
            if self._nearest(state) >= enough:
                return
        state.update(start)

    def _nearest(self, state: mink.Configuration) -> float:
        """Smallest distance of the pairs, up to the one that is kept [m]."""
        places, ends = state.data.geom_xpos[self._pairs], np.zeros(6)
        near = self._pairs[np.linalg.norm(places[:, 0] - places[:, 1], axis=1) <= self._reach]
        distances = (
            mujoco.mj_geomDistance(self._model, state.data, one, other, self._apart_m, ends)
            for one, other in near.tolist()
        )
        return min(distances, default=self._apart_m)


def _pairs(robot: RobotModel, model: Any, hand: set[int], apart_m: float) -> list[tuple[int, int]]:
    """Geoms of `model` that are to stay apart, without those that mink leaves out itself."""
    solid = [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    apart = set(model.exclude_signature.tolist())
    data, ends = mujoco.MjData(model), np.zeros(6)
    for joint in range(model.njnt):
        data.qpos[model.jnt_qposadr[joint]] = robot.home.get(model.joint(joint).name, 0.0)
    mujoco.mj_kinematics(model, data)
    found = []
    for place, one in enumerate(solid):
        for other in solid[place + 1 :]:
            low, high = sorted((int(model.geom_bodyid[one]), int(model.geom_bodyid[other])))
            if low == high or {low, high} <= hand or (low << 16) + high in apart or (high << 16) + low in apart:
                continue
            if mujoco.mj_geomDistance(model, data, one, other, apart_m, ends) >= apart_m:
                found.append((one, other))
    return found
