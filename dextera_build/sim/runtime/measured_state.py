"""The state that determines success from measurements alone, which are applied to the twin's model.

A cell without force sensors measures the robot's joints and the poses of tracked objects. The distances between
surfaces follow from the model, and a finger is assumed to press on an object if their distance is within the
measurement error. Success is judged by the same code as in simulation (`dextera_build.sim.primitives`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import poses, transforms
from dextera_build.policy.added import AddedTerm, AddedTerms
from dextera_build.policy.observation import Measurement
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import compile_folder
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.grasp import SUPPORT, Hands
from dextera_build.sim.primitives.state import GraspState, TaskState, opposed
from dextera_build.sim.primitives.success import Judge
from dextera_build.sim.render.robot_pixels import pose_robot
from dextera_build.sim.runtime import palms

NEAR_M = 0.008
"""Distance of two surfaces that are assumed to touch [m]: the combined error of calibration and tracker."""
WINDOW_S = 0.4
"""Time window of finite-difference speeds [s]: longer than a frame interval and its delay together."""


@dataclass(frozen=True)
class Hold:
    """The hands of a robot at one time."""

    palms: dict[str, np.ndarray]
    """Limb -> T_base_palm (4, 4)."""
    objects: dict[str, str]
    """Object -> the limb with fingers on both sides of it."""

    def carried(self, later: Hold) -> dict[str, np.ndarray]:
        """Object -> its motion until `later` if it moves with the hand, T_later_now (4, 4) in the base frame."""
        return {name: later.palms[limb] @ transforms.invert(self.palms[limb]) for name, limb in self.objects.items()}


class MeasuredState:
    """Judges one episode at a time from measurements.

    Args:
        twin: The task in the twin, without any information on the measured world.
        staged: Whether `stage` is followed.

    Raises:
        RuleError: MuJoCo cannot load the model.
    """

    def __init__(self, twin: TaskBundle, *, staged: bool = False) -> None:
        self._twin, self._staged = twin, staged
        self._model = compile_folder(twin.model)
        # MuJoCo adds the margins of two geoms; within the gap a contact is listed without a force.
        self._model.geom_margin[:] = NEAR_M / 2
        self._model.geom_gap[:] = NEAR_M / 2
        self._data = mujoco.MjData(self._model)
        self._hands = Hands(self._model, twin.robot, ROBOT)
        self._palms = palms.Palms(twin.robot, self._model)
        self._others = catalogue.of(twin.task, twin.objects).others()
        self._bodies = {name: int(self._model.body(name).id) for name in twin.objects}
        self._earlier: deque[tuple[float, dict[str, float], np.ndarray]] = deque()
        self._judge: Judge | None = None

    def begin(self, measured: Measurement) -> None:
        """Begin an episode with its first measurement."""
        mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        self._earlier.clear()
        self._judge = Judge(self._twin.task, self.state(measured, 0.0), self._twin.objects, staged=self._staged)

    def judge(self, measured: Measurement, time_s: float) -> bool:
        """Whether the task is done, `time_s` after the beginning [s], given this measurement and the earlier ones."""
        assert self._judge is not None, "`begin` comes first"
        return bool(self._judge.update(self.state(measured, time_s))[0])

    @property
    def stage(self) -> int:
        """The last stage of the primitive that was reached, from 1; 0: none."""
        return 0 if self._judge is None else int(self._judge.stage[0])

    @property
    def missing(self) -> str:
        """What the task lacks by the last measurement, in a few words; empty if its condition holds."""
        return "" if self._judge is None else str(self._judge.reasons[0])

    def positions(self, measured: Measurement) -> np.ndarray:
        """MuJoCo positions (Q,) of the twin's model in the measured state."""
        self._put(measured)
        return np.array(self._data.qpos)

    def state(self, measured: Measurement, time_s: float) -> TaskState:
        """The quantities that determine success (N = 1); forces are only directions here."""
        self._put(measured)
        model, data, twin = self._model, self._data, self._twin
        thing = twin.task.object
        joints = {name: float(data.joint(name).qpos[0]) for name in twin.objects[thing].joints}
        in_palms = self._in_palms(self._bodies[thing])
        while self._earlier and time_s - self._earlier[0][0] > WINDOW_S + 1e-9:
            self._earlier.popleft()
        before, joints_before, in_palms_before = self._earlier[0] if self._earlier else (time_s, joints, in_palms)
        self._earlier.append((time_s, joints, in_palms))
        span = max(time_s - before, 1e-9)
        slips = np.linalg.norm(in_palms - in_palms_before, axis=1) / span
        return TaskState(
            time_s=np.array([time_s]),
            world_from_object=self._pose(thing)[None],
            others={name: self._pose(name)[None] for name in self._others},
            joints={name: np.array([place]) for name, place in joints.items()},
            ranges={name: np.array([model.joint(name).range]) for name in joints},
            speeds={name: np.array([(place - joints_before[name]) / span]) for name, place in joints.items()},
            grasps=self._grasps(self._bodies[thing], slips),
        )

    def hold(self, measured: Measurement) -> Hold:
        """Poses of the hands, and the objects between their fingers."""
        self._put(measured)
        where = zip(self._hands.names, self._hands.palms, self.palm_poses(measured.joints), strict=True)
        palms = {name: poses.to_matrix(pose) for name, palm, pose in where if palm >= 0}
        still = np.zeros(len(self._hands.names))
        objects = {}
        for thing, body in self._bodies.items():
            holding = [name for name, grasp in self._grasps(body, still).items() if grasp.valid[0] and name in palms]
            if holding:
                objects[thing] = holding[0]
        return Hold(palms, objects)

    def added(self, terms: Sequence[AddedTerm]) -> AddedTerms | None:
        """Terms of a project, to be measured in the task; None if there are none; see `palms.added`."""
        return palms.added(self._twin, self._model, terms)

    def palms(self, joints: np.ndarray) -> np.ndarray:
        """Positions (L, 3) of the palms in the base at joint positions (A,) [m]; the origin if there is no palm."""
        return self.palm_poses(joints)[:, :3]

    def palm_poses(self, joints: np.ndarray) -> np.ndarray:
        """Poses (L, 7) of the palms in the base at joint positions (A,); the identity if there is no palm."""
        return np.asarray(self._palms(joints[None])[0])

    def _put(self, measured: Measurement) -> None:
        """Set robot and objects to the measured state."""
        data, twin = self._data, self._twin
        pose_robot(twin.robot, data, measured.joints)
        base = twin.base_pose.matrix
        for name, pose in zip(twin.objects, measured.objects, strict=True):
            root = self._model.body_jntadr[self._bodies[name]]
            first = self._model.jnt_qposadr[root]
            data.qpos[first : first + 7] = poses.from_matrix(base @ poses.to_matrix(pose))
        for name, place in zip(twin.displacement_names, measured.displacement, strict=True):
            data.joint(name).qpos[0] = place
        mujoco.mj_fwdPosition(self._model, data)

    def _pose(self, name: str) -> np.ndarray:
        body = self._data.body(name)
        return transforms.rigid(body.xmat.reshape(3, 3).copy(), body.xpos.copy())

    def _in_palms(self, body: int) -> np.ndarray:
        """The object's centre of mass in the frame of every palm (L, 3) [m]; in the world if there is no palm."""
        centre = self._data.xipos[body]
        return np.array(
            [
                centre
                if palm < 0
                else self._data.site_xmat[palm].reshape(3, 3).T @ (centre - self._data.site_xpos[palm])
                for palm in self._hands.palms
            ]
        )

    def _grasps(self, body: int, slips: np.ndarray) -> dict[str, GraspState]:
        """Limb -> grasp state (N = 1), from the surfaces near the object."""
        pushes, supported = np.zeros((self._hands.count, 3)), False
        roots = self._model.body_rootid[self._model.geom_bodyid]
        for number in range(self._data.ncon):
            one, other = self._data.contact.geom[number]
            inside = roots[one] == body, roots[other] == body
            if inside[0] == inside[1]:
                continue
            finger = int(self._hands.fingers[other if inside[0] else one])
            if finger == SUPPORT:
                supported = True
            else:
                # The normal points from the first geom to the second; closer surfaces press harder.
                near = max(NEAR_M - float(self._data.contact.dist[number]), 0.0)
                pushes[finger] += near * self._data.contact.frame[number][:3] * (-1.0 if inside[0] else 1.0)
        return {
            name: _grasp(pushes[self._hands.of(number)], supported, float(slips[number]))
            for number, name in enumerate(self._hands.names)
        }


def _grasp(pushes: np.ndarray, supported: bool, slip: float) -> GraspState:
    lengths = np.linalg.norm(pushes, axis=1)
    presses = lengths > 1e-9
    unit = (pushes / np.maximum(lengths, 1e-9)[:, None] * presses[:, None])[None]
    slips = np.array([slip if presses.any() else 0.0])
    return GraspState(np.array([presses.sum()]), opposed(unit), np.array([supported]), slips, unit)
