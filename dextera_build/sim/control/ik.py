"""Inverse kinematics of a robot's palms; while a target is tracked, arms can keep apart from the rest of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import daqp
import mink
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.control.apart import Apart
from dextera_build.sim.model.fixed_joints import alone

SOLVER = "daqp"
DAMPING = 1e-6
"""Weight of a radian of motion in one iteration."""
UNSOLVED = (mink.MinkError, np.linalg.LinAlgError)
"""Exceptions of a step without a solution: joint limits that exclude one another, or numbers that are not finite."""
ITERATIONS = 120
"""Maximum iterations per descent."""
STALLED = 12
"""Iterations without progress after which a descent ends, because the target is out of reach from there."""
SEED_SPREAD_RAD = 0.6
"""Standard deviation of restarts around the seed [rad]."""


@dataclass(frozen=True)
class Costs:
    """Weights of the errors in the least squares."""

    position: float
    """Of a metre of the palm."""
    rotation: float
    """Of a radian of the palm."""
    posture: float
    """Of a radian of a joint away from the posture."""


EXACT = Costs(position=10.0, rotation=1.0, posture=1e-2)
"""A millimetre weighs as much as 0.6 degrees, and the posture resolves the arm's redundancy without displacing the
hand."""


@dataclass(frozen=True)
class Solution:
    """Arm joints that bring the frame to a pose, with the residual error."""

    joints: np.ndarray
    """(A,) arm joints [rad]."""
    position_error_m: float
    """Remaining position error [m]."""
    rotation_error_rad: float
    """Remaining rotation error [rad]."""
    margin_rad: float
    """Smallest distance of a joint to its limit [rad]."""

    def reached(self, position_m: float = 0.002, rotation_rad: float = 0.01) -> bool:
        """Whether the residual is within these bounds [m, rad]."""
        return self.position_error_m <= position_m and self.rotation_error_rad <= rotation_rad


class ArmKinematics:
    """Forward and inverse kinematics of the palms of one or several limbs, with hands and other limbs fixed.

    The problem has a frame task per limb; mechanically coupled joints are constraints. Targets are (4, 4) T_base_palm,
    or (L, 4, 4) for several limbs in their order.

    Args:
        robot: The embodiment; all joints but those of the arms are fixed at home.
        limbs: Name of a limb with a palm, or several.
        costs: Weights of the errors.
        apart_m: Distance that arms keep from the rest of the robot in `track` [m]; 0: they know nothing of it.
    """

    def __init__(
        self, robot: RobotModel, limbs: str | Sequence[str], costs: Costs = EXACT, apart_m: float = 0.0
    ) -> None:
        self.limbs: tuple[str, ...] = (limbs,) if isinstance(limbs, str) else tuple(limbs)
        """The limbs, in the order of targets."""
        moved = {name for limb in self.limbs for name in robot.limbs[limb].arm}
        arm = [joint for joint in robot.joints if joint.name in moved]
        self.joints: tuple[str, ...] = tuple(joint.name for joint in arm)
        """Their arm joints, in the robot's order."""
        coupled = [each for each in robot.followers if each.group == "arm" and each.leader in moved]
        self._model = alone(robot, moved | {each.name for each in coupled})
        self._frames = [robot.frames[robot.limbs[limb].palm] for limb in self.limbs]
        self._sites = [int(self._model.site(frame).id) for frame in self._frames]
        self._address = np.array([self._model.joint(name).qposadr[0] for name in self.joints])
        self._coupled = [(int(self._model.joint(each.name).qposadr[0]), each) for each in coupled]
        self.lower = np.array([joint.lower for joint in arm])
        """(A,) lower limits [rad]."""
        self.upper = np.array([joint.upper for joint in arm])
        """(A,) upper limits [rad]."""
        self.home = np.array([joint.home for joint in arm])
        """(A,) home [rad]."""
        self._state = mink.Configuration(self._model)
        palm = (costs.position, costs.rotation)
        self._palms = [mink.FrameTask(frame, "site", *palm, lm_damping=1e-3) for frame in self._frames]
        self._posture, self._posture_cost = mink.PostureTask(self._model, costs.posture), costs.posture
        self._range = mink.ConfigurationLimit(self._model)
        self._speed = mink.VelocityLimit(self._model, {joint.name: joint.velocity for joint in arm})
        self._speeds = np.full(self._model.nv, np.inf)
        self._speeds[self._speed.indices] = self._speed.limit
        self._apart = Apart(robot, self._model, apart_m) if apart_m else None
        self._couplings = [mink.EqualityConstraintTask(self._model, cost=1.0)] if coupled else None

    @property
    def met(self) -> list[tuple[str, str]]:
        """Pairs of links that kept an arm from its target in the last step of `track`."""
        return self._apart.met if self._apart else []

    def pose(self, joints: np.ndarray) -> np.ndarray:
        """T_base_palm (4, 4) of the first limb at arm joints (A,) [rad]."""
        return np.asarray(self.poses(joints)[0])

    def poses(self, joints: np.ndarray) -> np.ndarray:
        """T_base_palm (L, 4, 4) at arm joints (A,) [rad]."""
        self._at(joints)
        data = self._state.data
        return np.array(
            [transforms.rigid(data.site_xmat[each].reshape(3, 3), data.site_xpos[each]) for each in self._sites]
        )

    def solve(
        self,
        target: np.ndarray,
        seed: np.ndarray | None = None,
        *,
        restarts: int = 6,
        posture: np.ndarray | None = None,
    ) -> Solution:
        """Solve for the nearest joints that bring the palms to `target`, from several starts.

        Args:
            target: T_base_palm, (4, 4) or (L, 4, 4).
            seed: (A,) initial joints [rad]; None: home. Restarts are drawn around it deterministically.
            restarts: Further starts if the first does not reach the target.
            posture: (A,) preferred joints for the redundancy [rad]; None: the seed.
        """
        start = self.home if seed is None else np.asarray(seed, np.float64)
        rest = start if posture is None else np.asarray(posture, np.float64)
        rng = np.random.default_rng(0)
        best: Solution | None = None
        for attempt in range(restarts + 1):
            guess = start + (rng.normal(0.0, SEED_SPREAD_RAD, len(start)) if attempt else 0.0)
            found = self._descend(target, np.clip(guess, self.lower, self.upper), rest)
            if best is None or _cost(found) < _cost(best):
                best = found
            if best.reached():
                break
        assert best is not None
        return best

    def track(
        self, target: np.ndarray, joints: np.ndarray, dt: float, *, posture: np.ndarray | None = None
    ) -> np.ndarray:
        """Joints (A,) [rad] after one control step of `dt` [s], as near to `target` as speed limits allow."""
        self._at(joints)
        self._aim(target)
        self._posture.set_target(self._spread(self.home if posture is None else posture))
        steps = 3
        start = self._state.q.copy()
        if self._apart:
            self._apart.begin(self._state)
        for _ in range(steps):
            self._step(dt / steps, timed=True)
        if self._apart and np.isfinite(self._state.q).all():
            self._apart.end(self._state, start)
        moved = np.asarray(self._state.q[self._address])
        return np.asarray(np.clip(moved, self.lower, self.upper) if np.isfinite(moved).all() else start[self._address])

    def step(self, target: np.ndarray, joints: np.ndarray, posture: np.ndarray) -> np.ndarray:
        """Joints (A,) [rad] after one step of the least squares from `joints` towards `target` and `posture` (A,)."""
        self._at(joints)
        self._aim(target)
        self._posture.set_target(self._spread(posture))
        self._step(1.0, timed=False)
        return np.array(self._state.q[self._address])

    def _descend(self, target: np.ndarray, guess: np.ndarray, rest: np.ndarray) -> Solution:
        self._at(guess)
        self._aim(target)
        self._posture.set_target(self._spread(rest))
        best, stalled = np.inf, 0
        for _ in range(ITERATIONS):
            before = self._state.q.copy()
            self._step(1.0, timed=False)
            if np.abs(self._state.q - before).max() < 1e-5:
                break
            missed = sum(float(np.abs(palm.compute_error(self._state)).sum()) for palm in self._palms)
            stalled = 0 if missed < 0.98 * best else stalled + 1
            best = min(best, missed)
            if stalled >= STALLED:
                break
        joints = np.clip(self._state.q[self._address], self.lower, self.upper)
        wanted = np.reshape(target, (-1, 4, 4))
        left = [transforms.invert(pose) @ each for pose, each in zip(self.poses(joints), wanted, strict=True)]
        return Solution(
            joints=joints,
            position_error_m=float(max(np.linalg.norm(each[:3, 3]) for each in left)),
            rotation_error_rad=max(transforms.angle(each[:3, :3]) for each in left),
            margin_rad=float(np.minimum(joints - self.lower, self.upper - joints).min()),
        )

    def _aim(self, target: np.ndarray) -> None:
        for task, pose in zip(self._palms, np.reshape(target, (-1, 4, 4)), strict=True):
            task.set_target(mink.SE3.from_matrix(np.asarray(pose, np.float64)))

    def _step(self, dt: float, *, timed: bool) -> None:
        """Move towards the targets within the joints' ranges, and with `timed` within their speeds."""
        if self._couplings is None:
            self._state.update(self._state.q + (self._kept_apart(dt) if timed else self._displacement(np.inf)))
            return
        limits = [self._range, self._speed, *([self._apart.limit] if self._apart else [])]
        velocity = mink.solve_ik(
            self._state,
            [*self._palms, self._posture],
            dt,
            solver=SOLVER,
            damping=DAMPING,
            limits=limits if timed else [self._range],
            constraints=self._couplings,
            safety_break=False,
        )
        if self._apart and timed:
            self._apart.spend(velocity * dt)
        self._state.integrate_inplace(velocity, dt)

    def _kept_apart(self, dt: float) -> np.ndarray:
        """A displacement within `dt` [s] that keeps parts of the robot apart, if it is to."""
        if self._apart is None:
            return self._displacement(dt)
        found = self._displacement(dt, self._apart.rows, self._apart.room)
        self._apart.spend(found)
        return found

    def _displacement(self, dt: float, further: np.ndarray | None = None, room: np.ndarray | None = None) -> np.ndarray:
        """The result of `mink.solve_ik` without constraints, in a third of the time.

        Every joint is a hinge or a slide, so that the limits of joints are bounds of single variables; if no limit is
        active, the solution of the normal equations is exact.

        Args:
            dt: Duration in which speeds are kept [s].
            further: (K, V) rows of further limits; None: there are none.
            room: (K,) their upper bounds.
        """
        parts = [palm.compute_qp_residual(self._state) for palm in self._palms]
        rows, errors = np.concatenate([each[0] for each in parts]), np.concatenate([each[1] for each in parts])
        joints, limits = self._state.q, self._range
        hessian = rows.T @ rows
        hessian.flat[:: len(joints) + 1] += DAMPING + self._posture_cost**2 + sum(each[2] for each in parts)
        gradient = self._posture_cost**2 * (joints - self._posture.target_q) - errors @ rows
        lower = np.maximum(limits.gain * (limits.lower - joints), -self._speeds * dt)
        upper = np.minimum(limits.gain * (limits.upper - joints), self._speeds * dt)
        further = np.zeros((0, len(joints))) if further is None else further
        room = np.zeros(0) if room is None else room
        free = np.linalg.solve(hessian, -gradient)
        if (free >= lower).all() and (free <= upper).all() and (further @ free <= room).all():
            return np.asarray(free)
        sense = np.zeros(len(joints) + len(room), np.int32)
        upper, lower = np.concatenate([upper, room]), np.concatenate([lower, np.full(len(room), -np.inf)])
        bounded, _, found, _ = daqp.solve(hessian, gradient, further, upper, lower, sense)
        if found <= 0:
            raise mink.NoSolutionFound(SOLVER)
        return np.asarray(bounded)

    def _at(self, joints: np.ndarray) -> None:
        """Forward kinematics at arm joints (A,) [rad], unless they are there already."""
        positions = self._spread(joints)
        if not np.array_equal(positions, self._state.q):
            self._state.update(positions)

    def _spread(self, joints: np.ndarray) -> np.ndarray:
        positions = self._model.qpos0.copy()
        positions[self._address] = joints
        for address, each in self._coupled:
            positions[address] = each.ratio * joints[self.joints.index(each.leader)] + each.offset
        return np.asarray(positions)


def _cost(solution: Solution) -> float:
    return EXACT.position * solution.position_error_m + EXACT.rotation * solution.rotation_error_rad
