"""Motion of a robot from a recorded motion of an operator's hands: a pure function of both."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import hands, quaternions, transforms
from dextera_build.sim.model.forward import Kinematics
from dextera_build.sim.retarget.arms import Palm, heading
from dextera_build.sim.retarget.fingers import Fingers, measured
from dextera_build.sim.retarget.matching import Matched, matched
from dextera_build.sim.retarget.options import Retargeting

BASE = "base"
"""Frame of streams whose poses are in the robot's base."""
BENT_M = 0.015
"""Mean bend of the fingers from which on a message tells a left hand from a right one [m]; see `hands.curl`."""
STRETCH = 2.0
"""How much longer than the last one the time between two messages may seem to the filter of the fingers."""
DOUBT = 0.8
"""Share of such messages that must say that a hand is mirrored."""


@dataclass(frozen=True)
class Targets:
    """Targets of one limb at every message."""

    side: str
    """Hand of the operator that moved it."""
    palms: np.ndarray
    """(N, 4, 4) T_base_palm; `sim.control.operator.PoseControl` brings arms there within their limits."""
    fingers: np.ndarray
    """(N, H) positions of the hand's motors, in the limb's order [rad]."""
    held: np.ndarray
    """(N,) whether the palm stays where it was: clutch open, tracking lost, or a jump."""
    scale: float
    """Metre of the robot's hand per metre of the operator's."""


def retarget(robot: RobotModel, stream: HandStream, options: Retargeting | None = None) -> dict[str, Targets]:
    """Targets of every limb that has a hand, by limb.

    A hand that is lost holds its fingers and its palm. Until a hand is seen for the first time, it is open.

    Args:
        robot: The embodiment; at the first message its palms are at home.
        stream: The operator's hands.
        options: Constants; None: the defaults.

    Raises:
        RuleError: A hand that is needed is never seen or is mirrored, or the robot has no hand.
    """
    options = headed(options or Retargeting(), stream)
    start = Kinematics(robot)
    start.pose({})
    limbs = [name for name in robot.limb_names if robot.limbs[name].hand]
    if not limbs:
        raise RuleError(
            f"the robot has no hand to move; its limbs: {listing(robot.limb_names)}",
            code="DXB-B523",
            hint="mark the links of the hand by `hand` in the robot's recipe",
        )
    return {name: follow(matched(robot, name), stream, start.frame(robot.limbs[name].palm), options) for name in limbs}


def due(step: int, period_s: float) -> float:
    """Time of a control step after the first message; messages up to it are heard [s]."""
    return step * period_s + 1e-9


def check_side(points: np.ndarray, side: str) -> None:
    """Raise if a motion (N, 25, 3) of a hand of `side` is that of the other one.

    Fingers bend to the palm alone, and the order of the fingers then says which hand it is (`hands.curl`). Messages
    with straight fingers say nothing.

    Raises:
        RuleError: It is mirrored.
    """
    bend = hands.curl(points) * (1 if side == hands.SIDES[1] else -1)
    told = np.abs(bend) > BENT_M
    if told.any() and (bend[told] < 0).mean() > DOUBT:
        raise RuleError(
            f"the {side} hand of the operator is mirrored: its fingers bend to the back of the hand",
            code="DXB-B524",
            facts={"messages that show it": f"{int((bend[told] < 0).sum())} of {int(told.sum())} with bent fingers"},
            hint="the device swapped the hands, or its frame is left-handed: swap both hands, or negate one axis",
        )


def headed(options: Retargeting, stream: HandStream) -> Retargeting:
    """The options with a heading; poses in the robot's base frame keep their axes."""
    known = options.heading_rad is not None or stream.frame == BASE
    heads = stream.known_heads
    if known or not len(heads):
        return options
    return replace(options, heading_rad=heading(quaternions.to_matrix(heads[0, 3:].astype(np.float64))))


class Follower:
    """One limb that follows an operator's hand message by message; recordings and live sessions share it.

    Args:
        own: Its hand and the operator's.
        lengths_m: (5,) lengths of the operator's fingers [m].
        palm: T_base_palm (4, 4) at the first message.
        options: Constants, with a heading.

    Raises:
        RuleError: The lengths are not known.
    """

    def __init__(self, own: Matched, lengths_m: np.ndarray, palm: np.ndarray, options: Retargeting) -> None:
        if not np.isfinite(lengths_m).all():
            raise RuleError(
                f"the lengths of the fingers of the operator's {own.side} hand are not known",
                code="DXB-B539",
                facts={"limb": own.limb, "lengths [m]": ", ".join(f"{each:.3f}" for each in lengths_m)},
                hint="hold the hand open before a take, or leave its lengths out of the recording",
            )
        self.own = own
        self._hand, self._palm = Fingers(own, lengths_m, options), Palm(palm, options)
        self.fingers = own.straight
        """Positions (H,) of the hand's motors at the last message [rad]."""
        self._stamp, self._period = np.nan, np.inf

    @property
    def scale(self) -> float:
        """Metre of the robot's hand per metre of the operator's."""
        return self._hand.beside.scale

    def next(
        self, points: np.ndarray, turn: np.ndarray, stamp: float, *, tracked: bool, clutch: bool
    ) -> tuple[np.ndarray, bool]:
        """The palm's target T_base_palm (4, 4), and whether it is held; `fingers` holds the hand's.

        Args:
            points: (25, 3) joints of the operator's hand [m]; not used if it is lost.
            turn: (4,) unit quaternion of its wrist.
            stamp: Time of the message, after that of the last one [s].
            tracked: Whether the hand is seen.
            clutch: Whether it moves the robot.
        """
        wrist, seconds = None, self._seconds(stamp)
        if tracked:
            points = points.astype(np.float64)
            self.fingers = self._hand.next(points, seconds)
            if clutch:
                wrist = transforms.rigid(
                    quaternions.to_matrix(turn.astype(np.float64)), self._hand.beside.origin(points)
                )
        return self._palm.next(wrist)

    def _seconds(self, stamp: float) -> float:
        """Time [s] since the last message, which has perhaps lost the hand, for the filter of the fingers.

        The filter passes at once what comes after a long time. Fingers that bent while nobody saw them would jump, so
        at most twice the last such time counts.
        """
        if np.isnan(self._stamp):
            self._stamp = stamp
            return 0.0
        gap, self._stamp = stamp - self._stamp, stamp
        self._period = min(gap, STRETCH * self._period)
        return self._period


def follow(own: Matched, stream: HandStream, palm: np.ndarray, options: Retargeting, first: int = 0) -> Targets:
    """Targets of one limb; those of a message depend on it and on earlier ones, and on the size of the hand.

    Args:
        own: Its hand and the operator's.
        stream: The operator's hands; the lengths of the fingers are those of its first take, or else medians.
        palm: T_base_palm (4, 4) at the first message.
        options: Constants, with a heading.
        first: The first message that counts; until then the limb stays where it is.

    Raises:
        RuleError: The hand is never seen or is mirrored, or the stream states lengths that are none.
    """
    hand = hands.SIDES.index(own.side)
    points, tracked = stream.positions[:, hand], stream.tracking[:, hand] > LOST
    if not tracked.any():
        raise RuleError(
            f"limb `{own.limb}` follows the operator's {own.side} hand, which is never seen",
            code="DXB-B525",
            facts={"messages": len(tracked)},
            hint=f"record both hands, or state `hands: {{{own.limb}: {{side: ...}}}}` in the robot's recipe",
        )
    check_side(points[tracked].astype(np.float64), own.side)
    known = stream.takes[0].finger_lengths_m[hand] if stream.takes else None
    lengths = np.array(known) if known else measured(points.astype(np.float64), tracked)
    follower = Follower(own, lengths, palm, options)
    count = len(points)
    fingers, palms, held = np.tile(own.straight, (count, 1)), np.tile(palm, (count, 1, 1)), np.ones(count, bool)
    for number in range(first, count):
        palms[number], held[number] = follower.next(
            points[number],
            stream.rotations[number, hand, hands.WRIST],
            float(stream.stamps[number]),
            tracked=bool(tracked[number]),
            clutch=bool(stream.clutch[number, hand]),
        )
        fingers[number] = follower.fingers
    return Targets(own.side, palms, fingers, held, follower.scale)
