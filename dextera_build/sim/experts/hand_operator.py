"""An operator whose commands are one take of a recording of hands, retargeted to the robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream, Take
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.geometry import hands, transforms
from dextera_build.sim.control.ik import ArmKinematics
from dextera_build.sim.control.operator import Aim, Command, State
from dextera_build.sim.retarget import motion
from dextera_build.sim.retarget.matching import Matched, matched
from dextera_build.sim.retarget.motion import Targets
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.sim.runtime.environment import Environment

SETTLE_S = 0.5
"""Time for the robot to come to rest after the last message, before the task's condition must hold [s]."""
NEAR_M = 0.05
"""Distance of a fingertip or a palm from the task's object at which free motion ends [m]; more than a hand lags behind
its command."""


def hands_of(robot: RobotModel) -> dict[str, Matched]:
    """Limb -> its hand beside the operator's.

    Raises:
        RuleError: A limb has no hand that an operator's hand can move.
    """
    return {limb: matched(robot, limb) for limb in robot.limb_names}


def patient(bundle: TaskBundle, recording: HandStream, takes: Sequence[Take]) -> TaskBundle:
    """The task with a time limit that no take exceeds: operators are slower than the robots that learn from them."""
    task = bundle.task
    longest = max(float(recording.stamps[take.last - 1] - recording.stamps[take.first]) for take in takes)
    limit = max(task.timeout_s, longest + SETTLE_S + task.hold_s)
    return bundle.model_copy(update={"task": task.model_copy(update={"timeout_s": limit})})


def needed(environment: Environment) -> set[str]:
    """Limbs without whose hands the task cannot be done."""
    return {*environment.task.limbs, *environment.primitive.ordered()}


class Labels:
    """Commands of one take with their segments.

    Motion is free, segment `approach`, until a hand comes near the task's object; from then on it is relative to the
    object, segment `manipulate`.

    Args:
        environment: The task.
        own: Limb -> its hand.
    """

    def __init__(self, environment: Environment, own: Mapping[str, Matched]) -> None:
        self._own, self._object = own, environment.task.object
        self._points = environment.bundle.objects[self._object].points.astype(np.float64)
        self._near = False

    def command(self, aims: Mapping[str, Aim], state: State) -> Command:
        """The command that brings the limbs to their targets."""
        self._near = self._near or self._at(aims, state.objects[self._object])
        if self._near:
            return Command(aims, "manipulate", self._object, True)
        return Command(aims, "approach")

    def _at(self, aims: Mapping[str, Aim], base_from_object: np.ndarray) -> bool:
        """Whether a hand is near the object at pose T_base_object (4, 4)."""
        points = transforms.apply(base_from_object, self._points)
        for limb, aim in aims.items():
            tips = transforms.apply(aim.palm, self._own[limb].hand.at(aim.fingers).tips)
            parts = np.concatenate([tips, aim.palm[None, :3, 3]])
            if np.linalg.norm(points[:, None] - parts, axis=-1).min() < NEAR_M:
                return True
        return False


class Palms:
    """Poses of the palms that hands move, from the joints of the robot.

    Args:
        robot: The embodiment.
        limbs: Limbs that are moved.
    """

    def __init__(self, robot: RobotModel, limbs: Iterable[str]) -> None:
        self._arm = ArmKinematics(robot, tuple(limbs))
        names = [joint.name for joint in robot.joints]
        self._places = np.array([names.index(name) for name in self._arm.joints], int)

    def at(self, state: State) -> dict[str, np.ndarray]:
        """Limb -> T_base_palm (4, 4)."""
        return dict(zip(self._arm.limbs, self._arm.poses(state.joints[self._places]), strict=True))


class HandOperator:
    """Moves palms and fingers as the operator's hands move, message by message and never ahead of time.

    Palms move relative to where they are at the first message of a closed clutch. A limb that the task does not need is
    not commanded before that message, as in the session that recorded the take.

    Args:
        environment: The task; only its data are used.
        own: Hands of the robot, `hands_of`.
        take: The messages of one take, `HandStream.during`.
        options: Constants of retargeting, with a heading.

    Raises:
        RuleError: No hand in the take moves the robot.
    """

    def __init__(
        self, environment: Environment, own: Mapping[str, Matched], take: HandStream, options: Retargeting
    ) -> None:
        robot, task = environment.bundle.robot, environment.task
        self._take, self._options = take, options
        must = needed(environment)
        self._own = {limb: hand for limb, hand in own.items() if limb in must or _drives(take, hand)}
        if not self._own:
            raise RuleError(
                "no hand in the take moves the robot: none is tracked while its clutch is closed",
                code="DXB-B526",
                facts=_seen(take)
                | {"the robot follows": ", ".join(f"{hand.side} ({limb})" for limb, hand in own.items())},
                hint="record the hand that the robot follows, with its clutch closed, "
                "or state `hands: {LIMB: {side: ...}}` in the robot's recipe",
            )
        self._first = _first_messages(take, self._own, must)
        self._palms, self._environment = Palms(robot, own), environment
        self._times = take.stamps - take.stamps[0]
        self.longest_s: float = float(self._times[-1]) + SETTLE_S + task.hold_s
        """Time after which the take has either done the task or failed [s]."""
        self._targets: dict[str, Targets] = {}
        self._steps, self._labels = 0, Labels(environment, self._own)

    def begin(self, state: State) -> None:
        """Retarget the take from the palms in `state`.

        Raises:
            RuleError: A hand that the task needs is never seen, or a hand is mirrored.
        """
        palms = self._palms.at(state)
        self._targets = {
            limb: motion.follow(hand, self._take, palms[limb], self._options, self._first[limb])
            for limb, hand in self._own.items()
        }
        self._steps, self._labels = 0, Labels(self._environment, self._own)

    def command(self, state: State) -> Command | None:
        """The targets of the last message that has come; None after the take."""
        now = motion.due(self._steps, self._environment.period_s)
        self._steps += 1
        if now > self._times[-1] + self._environment.period_s:
            return None
        row = int(np.searchsorted(self._times, now, side="right")) - 1
        aims = {
            limb: Aim(each.palms[row], each.fingers[row])
            for limb, each in self._targets.items()
            if row >= self._first[limb]
        }
        return self._labels.command(aims, state)


def _drives(take: HandStream, hand: Matched) -> bool:
    return bool(_closed(take, hand).any())


def _closed(take: HandStream, hand: Matched) -> np.ndarray:
    """Whether a hand moves the robot, in each message (N,)."""
    side = hands.SIDES.index(hand.side)
    return np.asarray(take.clutch[:, side] & (take.tracking[:, side] > LOST))


def _first_messages(take: HandStream, own: Mapping[str, Matched], must: set[str]) -> dict[str, int]:
    """Limb -> the message from which on it is commanded: its first closed clutch; from the start for the first."""
    found = {limb: 0 if limb in must else int(np.argmax(_closed(take, hand))) for limb, hand in own.items()}
    begin = min(found.values())
    return {limb: first if first > begin else 0 for limb, first in found.items()}


def _seen(take: HandStream) -> dict[str, str]:
    """Side -> how many messages track it, and in how many its clutch is closed."""
    tracked, closed = (take.tracking > LOST).sum(axis=0), take.clutch.sum(axis=0)
    return {
        f"{side} hand": f"tracked in {seen} of {len(take.stamps)} messages, clutch closed in {shut}"
        for side, seen, shut in zip(hands.SIDES, tracked.tolist(), closed.tolist(), strict=True)
    }
