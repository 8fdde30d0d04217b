"""Run a task bundle: start, step, measure. The common runtime of operators, policies, replays and Gymnasium."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.variation import EXACT
from dextera_build.errors import RuleError
from dextera_build.geometry import quaternions, transforms
from dextera_build.policy.added import AddedTerm
from dextera_build.policy.observation import DeployableObservation, Frames, Measurement, deployable
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import compile_folder
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.grasp import Hands
from dextera_build.sim.primitives.state import TaskState
from dextera_build.sim.primitives.success import Judge
from dextera_build.sim.runtime import palms, starts
from dextera_build.sim.runtime.dynamics import Dynamics
from dextera_build.sim.runtime.strata import Stratum

RAMP = 5
"""Interpolation steps to a new joint target within one control period, as in robot controllers."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one control period."""

    success: bool
    """Whether the task is done."""
    over: bool
    """Whether the episode has ended: done, out of time, or aborted."""
    reason: str
    """Reason for ending without success; empty otherwise."""
    executed: np.ndarray
    """Joint targets sent (A,) [rad]: the action limited to position and speed limits."""


@dataclass(frozen=True)
class _Frame:
    """A base frame and its world poses."""

    from_world: np.ndarray
    """T_base_world (4, 4)."""
    turn: np.ndarray
    """Its rotation as a quaternion."""

    @classmethod
    def of(cls, world_from_base: np.ndarray) -> _Frame:
        from_world = transforms.invert(world_from_base)
        return cls(from_world, quaternions.from_matrix(from_world[:3, :3]))

    def poses(self, positions: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """World positions (N, 3) [m] and quaternions (N, 4) as poses (N, 7) in this frame, w >= 0."""
        found = np.empty((len(positions), 7))
        found[:, :3] = positions @ self.from_world[:3, :3].T + self.from_world[:3, 3]
        for row, quaternion in zip(found[:, 3:], turns, strict=True):
            mujoco.mju_mulQuat(row, self.turn, quaternion)
            if row[0] < 0:
                row *= -1
        return found


class Environment:
    """One task in one world.

    Actions are targets (A,) of the robot's position controllers [rad] in the order of `RobotModel.joints`, sent at
    `TaskSpec.control_hz`.

    Args:
        bundle: The task.
        model: Its compiled model, which this environment takes over and modifies; None: compiled here.
        terms: Terms of observations that do not come with dxb.

    Raises:
        RuleError: MuJoCo cannot load the model, or two terms have the same name.
    """

    def __init__(
        self, bundle: TaskBundle, model: mujoco.MjModel | None = None, terms: Sequence[AddedTerm] = ()
    ) -> None:
        self.bundle = bundle
        self.specs = tuple(term.spec for term in terms)
        """Declarations of the terms that do not come with dxb."""
        self.staged = False
        """Whether `judge` of the next episodes follows the stages of the task; trials need them, training does not."""
        self._set_goal(bundle.task.goal)
        self.model = compile_folder(bundle.model) if model is None else model
        self.data, self._scratch = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        # Sleeping bodies cost nothing, and most objects sleep nearly all the time.
        self.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.substeps = max(1, round(1.0 / (self.task.control_hz * self.model.opt.timestep)))
        self.period_s = self.substeps * self.model.opt.timestep
        self._dynamics = Dynamics(bundle, self.model)
        self._index()
        self.added = palms.added(bundle, self.model, terms)
        """The terms that do not come with dxb."""
        self._known = _Frame.of(bundle.base_pose.matrix)
        self.begin(starts.photographed(bundle, self.model))

    def reset(self, seed: int, stratum: Stratum | None = None, share: float = 1.0) -> DeployableObservation:
        """Begin an episode at a start drawn by `draw`, from a fraction `share` of the task's ranges.

        Raises:
            RuleError: No start without collisions was found; the running episode continues.
        """
        try:
            start = self._drawn(seed, stratum, share)
        except RuleError:
            self._dynamics.shape(self.start.size_scale, self.start.base_error)
            raise
        return self.begin(start)

    def draw(self, seed: int, stratum: Stratum | None = None) -> Start:
        """Draw a start without beginning it; sizes and base of the running episode are unchanged.

        Args:
            seed: Any integer from 0 to 2^63.
            stratum: Position in a series of episodes with stratified sampling.

        Raises:
            RuleError: No start without collisions was found.
        """
        try:
            return self._drawn(seed, stratum, 1.0)
        finally:
            self._dynamics.shape(self.start.size_scale, self.start.base_error)

    def _drawn(self, seed: int, stratum: Stratum | None, share: float) -> Start:
        """A start; objects keep its sizes, and the robot its base."""
        changed, fair = self._dynamics, self.primitive.fair
        return starts.draw(self.bundle, self.model, self._scratch, changed, seed, fair, stratum=stratum, share=share)

    def begin(self, start: Start) -> DeployableObservation:
        """Begin an episode at a given start, without state from the previous one."""
        mujoco.mj_resetData(self.model, self.data)
        self._dynamics.apply(start, self.data)
        self._true = _Frame.of(self._dynamics.base.pose(start.base_error)) if any(start.base_error) else self._known
        self.data.qpos[:] = start.qpos
        self.data.ctrl[self._actuators] = start.ctrl[self._actuators]
        self._forward()
        self.start = start
        if self.task.goal != (start.variation.goal or self.bundle.task.goal):
            self._set_goal(start.variation.goal or self.bundle.task.goal)
        self.steps = 0
        self.previous_action = self.data.ctrl[self._actuators].copy()
        self._earlier = self.previous_action
        self._ranges = {name: self.model.jnt_range[[joint]] for name, joint, _, _ in self._inner}
        self.now = self.state()
        """The quantities that determine success, at the end of the last control period."""
        shapes = {name: each.sized(start.size_scale.get(name, 1.0)) for name, each in self.bundle.objects.items()}
        self.judge = Judge(self._judged, self.now, shapes, staged=self.staged)
        return self.observe()

    def step(self, action: np.ndarray, look: Callable[[], None] | None = None) -> Outcome:
        """Send joint targets for one control period.

        A non-finite target is not sent; it ends the episode with a reason. For `look` see `advance`.
        """
        target = self.limited(action)
        if target is None:
            return self.broken(action)
        self.advance(target, look)
        return self.conclude(target)

    def limited(self, action: np.ndarray) -> np.ndarray | None:
        """The targets (A,) [rad] sent for an action; None if it has another shape or is not finite."""
        action = np.asarray(action, np.float64)
        if action.shape != self.lower.shape or not np.isfinite(action).all():
            return None
        return self.within(action, self.previous_action)

    def within(self, actions: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Actions (..., A) [rad] limited to the ranges and the speeds of joints, where `before` was sent last."""
        near = np.minimum(np.maximum(actions, before - self._reach), before + self._reach)
        return np.asarray(np.minimum(np.maximum(near, self.lower), self.upper))

    def commands(self, target: np.ndarray) -> Iterator[int]:
        """Apply the commands on the way to `target` one by one, and yield the number of substeps for each."""
        earlier, before = self._earlier, self.previous_action
        sent = before + (target - before) * self._parts
        if self._late.any():
            sent = np.where(self._late, earlier + (before - earlier) * (1 + self._parts), sent)
        for row, steps in zip(sent, self._ramp, strict=True):
            self._ctrl[self._actuators] = row
            yield steps

    def arrive(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set positions and velocities that another simulator computed with `commands`."""
        self._qpos[:], self._qvel[:] = qpos, qvel
        self._forward()

    def conclude(self, target: np.ndarray) -> Outcome:
        """End a control period in which `target` was sent, with positions and forces up to date."""
        self.count(target)
        if self.diverged:
            return self.result(target, self.judge, False)
        self.now = self.state()
        return self.result(target, self.judge, bool(self.judge.update(self.now)[0]))

    def count(self, target: np.ndarray) -> None:
        """Count a control period in which `target` was sent."""
        self._earlier, self.previous_action = self.previous_action, target
        self.steps += 1

    @property
    def diverged(self) -> bool:
        """Whether a speed is beyond any sense, or not a number."""
        return not np.abs(self._qvel).max() <= 1e4

    def result(self, target: np.ndarray, judge: Judge, success: bool, number: int = 0) -> Outcome:
        """The outcome of a control period that is counted.

        Args:
            target: What was sent (A,) [rad].
            judge: Follows the episode.
            success: Its verdict.
            number: Number of this world among those of the judge.
        """
        if self.diverged:
            return Outcome(False, True, "the simulation diverged", target)
        late = self.steps * self.period_s >= self.task.timeout_s - 1e-9
        reason = "" if success or not late else self._why(judge, number)
        return Outcome(success, success or late, reason, target)

    def send(self, targets: np.ndarray) -> np.ndarray:
        """The method of a `RobotCell`: `step`, whose result is in `outcome`."""
        self.outcome = self.step(targets)
        return self.outcome.executed

    def observe(self, frames: Frames | None = None) -> DeployableObservation:
        """The current observation of a policy."""
        return deployable(self.measure(frames), self.previous_action, self.goal, self.added)

    def measure(self, frames: Frames | None = None) -> Measurement:
        """The current readings of joint encoders and a tracker, with the given frames of cameras."""
        qpos = self._qpos
        return Measurement(qpos[self._joints], self.object_poses(), qpos[self._displacements], frames or {})

    def object_poses(self) -> np.ndarray:
        """Poses of all objects in the base frame, (O, 7): position [m], quaternion w x y z with w >= 0.

        A tracker measures them by the calibration, so they are in the bundle's base frame, as the goal is.
        """
        return self._known.poses(self._xpos[self._objects], self._xquat[self._objects])

    def known_model(self) -> mujoco.MjModel:
        """A copy of the model for planning, with the robot at the bundle's base, without its error."""
        model = copy.copy(self.model)
        self._dynamics.base.put(model, EXACT)
        return model

    @property
    def base_from_world(self) -> np.ndarray:
        """T_base_world (4, 4) of the true base in this episode, see `Start.base_error`."""
        return self._true.from_world

    def poses(self, positions: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """World positions (N, 3) [m] and quaternions (N, 4) as poses (N, 7) in the frame of the true base."""
        return self._true.poses(positions, turns)

    def palm_poses(self) -> np.ndarray:
        """Poses of the palms in the true base (L, 7) by `RobotModel.limb_names`; the identity for a missing one.

        Encoders measure them, independent of the calibration.
        """
        found = np.tile([0.0, 0, 0, 1, 0, 0, 0], (len(self.hands.palms), 1))
        for row, palm in zip(found, self.hands.palms, strict=True):
            if palm >= 0:
                turn = np.zeros((1, 4))
                mujoco.mju_mat2Quat(turn[0], self.data.site_xmat[palm])
                row[:] = self.poses(self.data.site_xpos[[palm]], turn)[0]
        return found

    def contact_forces(self) -> np.ndarray:
        """Force on each fingertip's finger in the true base (F, 3) [N] by `RobotModel.tips`; privileged."""
        forces = self.hands.tip_forces(self.model, self.data)
        return np.asarray(forces @ self.base_from_world[:3, :3].T)

    def state(self) -> TaskState:
        """The quantities that determine success (N = 1)."""
        return TaskState(
            time_s=np.array([self.steps * self.period_s]),
            world_from_object=self._pose_of(self._target)[None],
            others={name: self._pose_of(body)[None] for name, body in self._others.items()},
            joints={name: self._qpos[place : place + 1].copy() for name, _, place, _ in self._inner},
            ranges=self._ranges,
            speeds={name: self._qvel[speed : speed + 1].copy() for name, _, _, speed in self._inner},
            grasps=self.hands.grasps(self.model, self.data, self._target) if self.primitive.feels else {},
        )

    def _set_goal(self, goal: Goal) -> None:
        """Set the objective."""
        self.task = self.bundle.task.model_copy(update={"goal": goal})
        self.primitive = catalogue.of(self.task, self.bundle.objects)
        # With the same object as goal, judge and reward share what both compute of a state.
        self._judged = self.task.model_copy(update={"goal": self.primitive.goal})
        self.goal = np.array(self.primitive.goal.numbers(self.bundle.base_pose.inverse().matrix), np.float32)

    def _pose_of(self, body: int) -> np.ndarray:
        """T_world_body (4, 4)."""
        return transforms.rigid(self._xmat[body].reshape(3, 3), self._xpos[body])

    def advance(self, target: np.ndarray, look: Callable[[], None] | None = None) -> None:
        """Simulate a control period on the way to `target` (A,) [rad], and make positions and forces match.

        Args:
            target: Joint targets.
            look: Called after every substep, when contacts and their forces are those at its beginning; it may only
                read, and the motion is the same bit for bit.
        """
        # The first step can reuse the results of `mj_forward`, unless positions were changed since.
        ready = self._seen == (self._qpos.tobytes(), self._qvel.tobytes())
        for steps in self.commands(target):
            if ready:
                mujoco.mj_step2(self.model, self.data)
                if look is not None:
                    look()
            rest, ready = steps - ready, False
            if look is None:
                if rest:
                    mujoco.mj_step(self.model, self.data, rest)
                continue
            for _ in range(rest):
                mujoco.mj_step(self.model, self.data)
                look()
        self._forward()

    def _forward(self) -> None:
        """Update positions, contacts and forces, which `mj_step` leaves one step behind."""
        mujoco.mj_forward(self.model, self.data)
        self._seen = self._qpos.tobytes(), self._qvel.tobytes()

    def broken(self, action: np.ndarray) -> Outcome:
        """The outcome of an action that cannot be sent."""
        action = np.asarray(action, np.float64)
        if action.shape != self.lower.shape:
            reason = f"the action has shape {action.shape}, but the robot has {len(self.lower)} joints"
        else:
            bad = self.bundle.robot.joints[int(np.flatnonzero(~np.isfinite(action))[0])].name
            reason = f"the action for `{bad}` is not a finite number"
        return Outcome(False, True, reason, self.previous_action.copy())

    def _why(self, judge: Judge, number: int) -> str:
        if judge.held_at_reset[number]:
            return "the condition held at the start already"
        return f"not done within {self.task.timeout_s:g} s: {judge.reasons[number] or 'not held for long enough'}"

    def _index(self) -> None:
        model, robot = self.model, self.bundle.robot
        names = [ROBOT + joint.name for joint in robot.joints]
        self._joints = np.array([model.joint(name).qposadr[0] for name in names])
        self._actuators = np.array([model.actuator(name).id for name in names])
        self.lower = np.array([joint.lower for joint in robot.joints])
        self.upper = np.array([joint.upper for joint in robot.joints])
        self._reach = np.array([joint.velocity for joint in robot.joints]) * self.period_s
        self._objects = np.array([model.body(name).id for name in self.bundle.objects])
        self._displacements = np.array([model.joint(name).qposadr[0] for name in self.bundle.displacement_names], int)
        self._target = int(model.body(self.task.object).id)
        self._others = {name: int(model.body(name).id) for name in self.primitive.others()}
        inner = [(name, model.joint(name)) for name in self.bundle.objects[self.task.object].joints]
        self._inner = [(name, joint.id, int(joint.qposadr[0]), int(joint.dofadr[0])) for name, joint in inner]
        # Views of the state, because every access to a field of `MjData` creates a new one.
        data = self.data
        self._qpos, self._qvel, self._ctrl = data.qpos, data.qvel, data.ctrl
        self._xpos, self._xquat, self._xmat = data.xpos, data.xquat, data.xmat
        self.hands = Hands(model, robot, ROBOT)
        pieces, late = min(RAMP, self.substeps), self.bundle.latency_s / self.period_s
        upto = [self.substeps * piece // pieces for piece in range(pieces + 1)]
        self._ramp = [upto[piece] - upto[piece - 1] for piece in range(1, pieces + 1)]
        """Substeps with each command on the way to a new target."""
        self._parts = np.array([[piece / pieces - late] for piece in range(1, pieces + 1)])
        """Fraction of the way of each command (K, 1); below 0 the previous target is still active."""
        self._late = self._parts < 0
