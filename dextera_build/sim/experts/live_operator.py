"""An operator whose hands arrive while the task runs; what is heard replays as a recording, bit for bit."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST
from dextera_build.geometry import hands
from dextera_build.sim.control.operator import Aim, Command, State
from dextera_build.sim.experts.hand_operator import SETTLE_S, Labels, Palms, needed
from dextera_build.sim.retarget.matching import Matched
from dextera_build.sim.retarget.motion import Follower, due
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.sim.runtime.environment import Environment

TICKS_HZ = 512
"""Resolution of the times of messages. A tick is a whole number of nanoseconds (1,953,125), as files hold times, and a
power of two, so that differences of times are exact wherever a recording begins."""

FRESH_S, PATIENT_S = 0.004, 0.014
"""A control step whose newest message is older waits for the next one, at most that long: a headset sends one every
14 ms, so a command is rarely older than the time that it takes to compute. Steps after it keep their times [s]."""


@dataclass(frozen=True)
class Message:
    """Hands of an operator at one moment, in the robot's base frame, rounded as a recording stores them."""

    number: int
    """Counts the messages of the device."""
    arrived: float
    """When it came, by `time.perf_counter` [s]."""
    positions: np.ndarray
    """(2, 25, 3) float32 joints of the left and the right hand in WebXR's order [m]; NaN where a hand is lost."""
    rotations: np.ndarray
    """(2, 25, 4) float32 unit quaternions w x y z of the joints; NaN where a hand is lost."""
    tracking: np.ndarray
    """(2,) uint8, see `HandStream.tracking`."""
    clutch: np.ndarray
    """(2,) bool: whether a hand moves the robot."""
    pinch: np.ndarray
    """(2,) float32, 0 (open) to 1 (closed)."""
    head: np.ndarray
    """(7,) float32 position [m] and quaternion w x y z; NaN without a head."""


class Refused(Exception):  # noqa: N818  a message that is not used, while the session goes on
    """A message that cannot be read; the text says why."""


class Inbox:
    """The newest message of a device: an older one that was not taken yet is dropped unread, never queued."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._message: Callable[[], Message] | None = None
        self._came = self._heard = -np.inf
        self._refused = False
        self.dropped = 0
        """Messages that a newer one replaced."""
        self.arrived = -np.inf
        """When the newest message came that was not refused, by `time.perf_counter` [s]. One that was not read yet
        counts, unless the last one was refused."""

    def put(self, message: Callable[[], Message]) -> None:
        """Leave what reads a message, and may raise `Refused`, from any thread."""
        with self._changed:
            self.dropped += self._message is not None
            self._message, self._came = message, time.perf_counter()
            if not self._refused:
                self.arrived = self._came
            self._changed.notify()

    def wake(self) -> None:
        """Let `take` return without a message, because something else has happened."""
        with self._changed:
            self._changed.notify()

    def take(self, timeout_s: float) -> Message | None:
        """Read the newest message, waited for at most `timeout_s`; None if there is none, or it is refused."""
        with self._changed:
            if self._message is None and timeout_s > 0:
                self._changed.wait(timeout_s)
            found, self._message = self._message, None
            came = self._came
        if found is None:
            return None
        try:
            message = found()
        except Refused:
            message = None
        with self._changed:
            self._refused = message is None
            self._heard = self._heard if message is None else came
            self.arrived = self._heard if message is None else self._came
        return message


class Ended(Exception):  # noqa: N818  a wish of the operator or a lost connection, not a fault
    """The take ended before the task was done; the text says why."""


class LiveOperator:
    """Moves palms and fingers as the operator's hands move now, step by step in real time or slow motion.

    Args:
        environment: The task; only its data are used.
        own: Hands of the robot, `hand_operator.hands_of`.
        lengths_m: (2, 5) lengths of the operator's fingers, left and right [m]; NaN of a hand that was not measured,
            which then moves nothing.
        options: Constants of retargeting, with a heading of 0.
        inbox: Where messages arrive.
        check: Called while waiting, at least once per control step; it may raise `Ended`.
        speed: Simulated time per real time; below 1 for slow motion.
    """

    def __init__(
        self,
        environment: Environment,
        own: Mapping[str, Matched],
        lengths_m: np.ndarray,
        options: Retargeting,
        inbox: Inbox,
        check: Callable[[], None],
        speed: float = 1.0,
    ) -> None:
        self._environment, self._all, self._lengths, self._options = environment, own, lengths_m, options
        self._inbox, self._check = inbox, check
        self._period, self._speed = environment.period_s, speed
        self.rows: list[tuple[int, Message]] = []
        """Messages that were heard, with their times after the first in ticks."""
        self.used: Message | None = None
        """The message behind the last command."""
        self.aims: dict[str, Aim] = {}
        """Limb -> its last target."""
        self.held: dict[str, bool] = {}
        """Limb -> whether its palm stays where it is: clutch open, tracking lost, or a jump."""
        self.heard = 0.0
        """Processor time of this thread when the last message was heard [s]."""
        self.late = 0
        """Control steps that began a period late or more: the machine is slower than real time."""
        self._last_step: int | None = None

    def begin(self, state: State) -> None:
        """Wait for the first message in which a hand moves the robot. Other limbs join when their clutch closes.

        Raises:
            Ended: `check` ended the take.
        """
        first = self._inbox.take(0)
        while first is None or not self._drives(first):
            self._check()
            first = self._inbox.take(self._period)
        self._palms = Palms(self._environment.bundle.robot, self._all).at(state)
        self._followers: dict[str, Follower] = {}
        self._labels = Labels(self._environment, self._all)
        self._join(needed(self._environment))
        self._steps, self._ticks = 0, -1
        self._hear(first)
        self._began = time.perf_counter()

    def command(self, state: State) -> Command | None:
        """The targets of the newest message when the control step is due.

        Raises:
            Ended: `check` ended the take, or the time after `finish` is over.
        """
        self._listen(self._began + self._steps * self._period / self._speed)
        if self._last_step is not None and self._steps >= self._last_step:
            why = self._environment.judge.reasons[0] or "not held for long enough"
            raise Ended(f"the task was not done when the operator finished: {why}")
        self._steps += 1
        self.used = self.rows[-1][1]
        return self._labels.command(self.aims, state)

    def finish(self) -> None:
        """Hear no more messages; the robot has the time to come to rest that a replay has."""
        rest = SETTLE_S + self._environment.task.hold_s
        self._last_step = self._last_step or self._steps + round(rest / self._period)

    @property
    def finishing(self) -> bool:
        """Whether the operator has finished, and the robot comes to rest."""
        return self._last_step is not None

    def _listen(self, until: float) -> None:
        """Hear messages until a time of `time.perf_counter`, and a little longer for one that is due.

        A simulation that is late does not catch up.
        """
        behind = time.perf_counter() - until
        if behind > self._period / self._speed:
            self._began += behind
            self.late += 1
        while True:
            self._check()
            self._take(until)
            if time.perf_counter() >= until:
                break
        if not self.finishing and time.perf_counter() - self.rows[-1][1].arrived > FRESH_S:
            self._take(until + PATIENT_S)

    def _take(self, until: float) -> None:
        """Wait for one message until a time of `time.perf_counter`."""
        message = self._inbox.take(until - time.perf_counter())
        if message is not None and not self.finishing:
            self._hear(message)

    def _hear(self, message: Message) -> None:
        """Retarget a message, timed between the last control step and the next one, so that a replay uses it there."""
        earliest = int(due(self._steps - 1, self._period) * TICKS_HZ) + 1 if self._steps else 0
        latest = int(due(self._steps, self._period) * TICKS_HZ)
        now = round((message.arrived - self._began) * self._speed * TICKS_HZ) if self._steps else 0
        ticks = min(max(now, earliest, self._ticks + 1), latest)
        if ticks <= self._ticks:
            return  # within a tick of the last message
        self._ticks, self.heard = ticks, time.thread_time()
        self.rows.append((ticks, message))
        self._join(self._drives(message))
        aims = {}
        for limb, follower in self._followers.items():
            hand = hands.SIDES.index(follower.own.side)
            palm, self.held[limb] = follower.next(
                message.positions[hand],
                message.rotations[hand, hands.WRIST],
                ticks / TICKS_HZ,
                tracked=bool(message.tracking[hand] > LOST),
                clutch=bool(message.clutch[hand]),
            )
            aims[limb] = Aim(palm, follower.fingers)
        self.aims = aims

    def _drives(self, message: Message) -> set[str]:
        """Limbs whose hand was measured, and moves the robot in a message."""
        closed = (message.tracking > LOST) & message.clutch & np.isfinite(self._lengths).all(axis=1)
        return {limb for limb, each in self._all.items() if closed[hands.SIDES.index(each.side)]}

    def _join(self, limbs: set[str]) -> None:
        """Let further limbs follow their hands; the order of limbs stays that of the robot's."""
        for limb in limbs - self._followers.keys():
            own = self._all[limb]
            lengths = self._lengths[hands.SIDES.index(own.side)]
            self._followers[limb] = Follower(own, lengths, self._palms[limb], self._options)
        self._followers = {limb: self._followers[limb] for limb in self._all if limb in self._followers}

    def sides(self) -> list[int]:
        """Hands that drive the robot."""
        return [hands.SIDES.index(each.own.side) for each in self._followers.values()]
