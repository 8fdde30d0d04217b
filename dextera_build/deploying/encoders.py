"""Notices joint states that cannot be those of the joints that are commanded.

A position that jumps is none of a joint. A joint of an arm that goes away from its targets has positions of another
sign than its commands, or those of another joint, and the policy would send it further and further. A joint whose
positions and commands both have the other sign follows its targets, and does not show here. Fingers are not compared
with their targets: what they touch, and the arm's own motion, move them as well. An arm that never moves does not get
its commands, or refuses them; its targets stay near it, because it would jump to them when it gets them again.
"""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import listing

MOVED_RAD, OF_RANGE = 0.05, 0.05
"""Motion that shows a direction: the smaller one of this [rad or m] and of this fraction of the joint's range."""
BEYOND = 4.0
"""Multiple of that motion by which no load moves a joint beyond all its targets."""
STILL, STILL_S = 0.2, 1.0
"""Fraction of that motion below which a joint is still, and for how long it may be while it should move [s]."""
FASTER = 3.0
"""Multiple of the speed limit of a joint above which no joint moves."""
FOLLOWS_S = 0.25
"""Time within which a joint of an arm follows its targets: its own lag, and the age of its position [s]."""
AHEAD = 1.5
"""Multiple of the motion that shows a direction by which a target may always be ahead of its joint."""
OPPOSITE = 0.5
"""Fraction of that motion that shows the opposite direction where a target had to wait for its joint."""


class Encoders:
    """Compares the positions of joints with their targets and with the positions before.

    Args:
        robot: The embodiment.
        speed: Fraction of the joints' speed limits that is allowed.
        period_s: Control period [s].
    """

    def __init__(self, robot: RobotModel, speed: float, period_s: float) -> None:
        self._names = [joint.name for joint in robot.joints]
        lower, upper, self._speed = (
            np.array([getattr(joint, name) for joint in robot.joints]) for name in ("lower", "upper", "velocity")
        )
        self._moved = np.minimum(MOVED_RAD, OF_RANGE * (upper - lower))
        self._stiff = np.array([joint.group == "arm" for joint in robot.joints])
        self._lower, self._upper = lower, upper
        self._allowed, self._follows_s = speed * self._speed, FOLLOWS_S + period_s
        self.begin(np.zeros(len(self._names)))

    def begin(self, positions: np.ndarray) -> None:
        """Begin where the robot is, positions (A,) [rad or m]."""
        self._start = np.array(positions)
        self._low, self._high = np.zeros(len(self._names)), np.zeros(len(self._names))
        self._shown = np.zeros(len(self._names), bool)
        self._rest, self._rest_target, self._targets = (np.array(positions) for _ in range(3))
        self._since = np.full(len(self._names), np.inf)
        self._last: tuple[float, np.ndarray] | None = None
        self._commands, self._waits = False, np.zeros(len(self._names), bool)
        self._least, self._most = np.full(len(self._names), -np.inf), np.full(len(self._names), np.inf)

    def near(self, targets: np.ndarray, positions: np.ndarray, delay_s: float) -> np.ndarray:
        """Targets (A,) that are no farther ahead of the joints of arms than these follow.

        Args:
            targets: Requested targets (A,) [rad or m].
            positions: The newest positions (A,) [rad or m].
            delay_s: Time of a message to the robot and back [s].
        """
        most = np.maximum(AHEAD * self._moved, self._allowed * (self._follows_s + delay_s))
        most = np.where(self._stiff, most, np.inf)
        self._least, self._most = positions - most, positions + most
        return np.asarray(np.clip(targets, self._least, self._most))

    def sent(self, targets: np.ndarray, wanted: np.ndarray) -> None:
        """Note targets (A,) that were sent [rad or m], and those that were wanted (A,)."""
        self._waits = (targets <= self._least) | (targets >= self._most)
        # A target that waits for its joint does not show how far the joint stays behind.
        there = np.where(self._waits, np.clip(wanted, self._lower, self._upper), targets)
        away, self._commands, self._targets = there - self._start, True, there
        self._low, self._high = np.minimum(self._low, away), np.maximum(self._high, away)

    def fault(self, time_s: float, positions: np.ndarray) -> str:
        """Why positions (A,) [rad or m] at a time [s] cannot be right; empty if they can be."""
        before, self._last = self._last, (time_s, positions)
        if before is not None:
            far = self._speed * FASTER * max(0.0, time_s - before[0]) + self._moved
            jumped = np.flatnonzero(np.abs(positions - before[1]) > far)
            if len(jumped):
                told = [f"{self._names[row]} from {before[1][row]:.3f} to {positions[row]:.3f}" for row in jumped]
                return f"positions jumped in {time_s - before[0]:.3f} s: {', '.join(told)}"
        # Where nothing is sent, as while a demonstration is recorded, another program moves the joints.
        if not self._commands:
            return ""
        return self._astray(positions - self._start) or self._still(time_s, positions)

    def _still(self, time_s: float, positions: np.ndarray) -> str:
        """Joints of arms that stay where they are while their targets go away; what they touch may hold them up."""
        moves = np.abs(positions - self._rest) > STILL * self._moved
        self._rest = np.where(moves, positions, self._rest)
        self._rest_target = np.where(moves, self._targets, self._rest_target)
        followed = np.abs(self._rest - self._start) > 0.0
        since = np.where(self._waits, positions, self._rest_target)
        away = np.abs(self._targets - since) > np.where(followed, BEYOND, 1.0) * self._moved
        self._since = np.where(away & ~moves, np.minimum(self._since, time_s), np.inf)
        names = [self._names[row] for row in np.flatnonzero((time_s - self._since > STILL_S) & self._stiff)]
        told = "its controller refuses the commands, a brake holds it, or something blocks it"
        return f"the robot does not follow: {listing(names)} did not move in {STILL_S:g} s; {told}" if names else ""

    def _astray(self, away: np.ndarray) -> str:
        """Joints of arms that moved opposite to all their targets, or far beyond them; `away` (A,) [rad or m]."""
        shows = np.where(self._waits, OPPOSITE, 1.0) * self._moved
        up, down = away > shows, away < -shows
        sent_up, sent_down = self._high > self._moved, self._low < -self._moved
        self._shown |= (up & sent_up) | (down & sent_down)
        opposite = ~self._shown & ((up & sent_down & ~sent_up) | (down & sent_up & ~sent_down))
        beyond = np.maximum(away - self._high, self._low - away)
        wrong = opposite | (beyond > np.where(self._waits, OPPOSITE, BEYOND) * self._moved)
        names = [self._names[row] for row in np.flatnonzero(wrong & self._stiff)]
        told = "positions and commands have different signs, or belong to different joints"
        return f"{listing(names)} moved away from the targets: {told}" if names else ""
