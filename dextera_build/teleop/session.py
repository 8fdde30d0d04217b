"""A live session: takes of a task from hands that arrive, in a thread of its own, in real time."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.robots.hand_stream import LOST
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.geometry import hands, quaternions
from dextera_build.sim.control.operator import Command
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.experts.hand_operator import hands_of, needed
from dextera_build.sim.experts.live_operator import Ended, Inbox, LiveOperator, Message
from dextera_build.sim.retarget import motion
from dextera_build.sim.retarget.arms import heading
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.sim.runtime.environment import Outcome
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.teleop import protocol, twin_file
from dextera_build.teleop.delay import Delays
from dextera_build.teleop.measure import Measure
from dextera_build.teleop.takes import Kept, Takes, seen
from dextera_build.view.task import running

SILENT_S, LOST_S = 0.3, 2.0
"""Time without a message after which the robot is shown as held, and after which the take stops [s]."""
FREE_BYTES = 50_000_000
"""No take begins with less free disk: it might not be kept."""
FILTERS = Filters(lag_m=0.02, press_n=2.0, fingers=True)
"""Limits whose violation ends a take: those with which demonstrate.operate replays it by default."""
IDLE_S = 1 / 30
"""Period of pictures between takes [s]."""


@dataclass(frozen=True)
class Plan:
    """What a session is to record."""

    takes: int
    """Number of takes."""
    seed: int
    """Seed of the starts, as option `seed` of demonstrate.operate."""
    starts: tuple[int, ...]
    """Seeds of the first starts, before those that are drawn."""
    limit_s: float
    """Longest take [s] of simulated time."""
    speed: float
    """Simulated time per real time."""
    retargeting: Retargeting
    """Constants, with a heading of 0: messages are in the base frame."""
    limits: Limits = field(default_factory=Limits)
    """Limits that the guard enforces on the robot."""


class Session(threading.Thread):
    """Draws starts, runs takes and keeps those that do the task.

    Args:
        bundle: The task.
        plan: What to record.
        takes: The recording.
        publish: Called with every new state, from this thread.

    Raises:
        RuleError: The robot has no hands that an operator's can move.
    """

    def __init__(self, bundle: TaskBundle, plan: Plan, takes: Takes, publish: Callable[[bytes], None]) -> None:
        super().__init__(name="session", daemon=True)
        self.plan, self.takes, self._publish = plan, takes, publish
        task = bundle.task
        patient = task.model_copy(update={"timeout_s": max(task.timeout_s, plan.limit_s)})
        environment = running(bundle.model_copy(update={"task": patient}))
        self.driver = Driver(environment, apart_m=plan.retargeting.apart_m, limits=plan.limits)
        self.environment = self.driver.environment
        self.own = hands_of(bundle.robot)
        for limbs in _moved_together(self.own, needed(self.environment)):
            # It takes a tenth of a second, which a take's first message must not wait for.
            self.driver.control.arms(limbs)
        self.twin = twin_file.written(self.environment, self.own)
        """The file of `twin_file`."""
        self.inbox, self.measure = Inbox(), Measure()
        self.heading_rad = 0.0
        """Angle about the vertical from the operator's axes to those of the base [rad]."""
        self.own_share = Delays()
        """Times from the arrival of messages until their joint targets are sent [ms]."""
        self.processor = Delays()
        """Processor time within them [ms]: retargeting, segments, inverse kinematics."""
        self.error: BaseException | None = None
        """What ended the thread, if it was no wish."""
        self.connected = False
        """Whether an operator's page is there."""
        self.camera = False
        """Whether a camera shows the hands, and not the operator's page."""
        self.discarded = False
        """Whether the end of the session discarded a take that was running."""
        self._wishes: list[str] = []
        self._number = 0
        self._numbers: list[int] = []
        self._guard = threading.Lock()
        self._told, self._phase = "", "ready"
        self._live: LiveOperator | None = None
        self._scales: Mapping[str, float] = {}
        self._sent: Message | None = None
        self._last: Message | None = None
        self._command: Command | None = None
        self._preview = 0.0

    def wish(self, what: str) -> None:
        """Ask for start, finish, discard, undo, skip, recentre, measure or end, from any thread."""
        with self._guard:
            self._wishes.append(what)
        self.inbox.wake()

    def run(self) -> None:
        """Run takes until the session is ended."""
        try:
            self._draw()
            while self._phase != "ended":
                self._idle()
        except BaseException as error:
            self.error, self._phase = error, "ended"
        self._show()

    @property
    def ended(self) -> bool:
        """Whether no take will follow."""
        return self._phase == "ended"

    def _draw(self) -> None:
        """Begin at the start of the next take."""
        given = self.plan.starts
        drawn = seed_of("operate", self.plan.seed, self._number - len(given))
        self._seed = given[self._number] if self._number < len(given) else drawn
        start = self.environment.draw(self._seed)
        self.environment.begin(start)
        self._start, self._scales = start, start.size_scale

    def _idle(self) -> None:
        message = self.inbox.take(IDLE_S)
        if message is not None:
            self._last = message
            self.measure.add(message)
        for what in self._wished():
            getattr(self, f"_do_{what}", self._nothing)()
        if time.perf_counter() - self._preview > IDLE_S:
            self._preview = time.perf_counter()
            self._show()

    def _wished(self) -> list[str]:
        with self._guard:
            found, self._wishes = self._wishes, []
        return found

    def _nothing(self) -> None:
        """A wish that means nothing between takes."""

    def _do_end(self) -> None:
        if self.takes.unsaved:
            self.takes.save()
        if self.takes.unsaved:
            self._told = f"the recording is not written yet: {self.takes.unsaved}; free the disk and end again"
        else:
            self._told = "the take that was running was discarded" if self.discarded else ""
            self._phase = "ended"

    def _do_undo(self) -> None:
        dropped = self.takes.undo()
        self._told = "there is no take to drop" if dropped is None else "the last take was dropped"
        self._number = self._numbers.pop() if dropped else self._number
        self._draw()

    def _do_skip(self) -> None:
        self._number += 1
        self._told = "another start"
        self._draw()

    def _do_measure(self) -> None:
        self.measure = Measure()
        self._told = "hold both hands open"

    def _do_recentre(self) -> None:
        if self._last is not None and np.isfinite(head := self._last.head).all():
            self.heading_rad += heading(quaternions.to_matrix(head[3:].astype(np.float64)))
            # This head was turned by the old angle: a second wish needs a message that is turned by the new one.
            self._last = replace(self._last, head=np.full(7, np.nan, np.float32))

    def _do_start(self) -> None:
        self._told = self._hindrance()
        if not self._told:
            self._take()

    def _hindrance(self) -> str:
        """Why no take can begin now, or ""."""
        if len(self.takes.kept) >= self.plan.takes:
            return f"all {self.plan.takes} takes are recorded: end the session, or drop the last take"
        must, sides = needed(self.environment), {limb: own.side for limb, own in self.own.items()}
        missing = " and the ".join(side for limb, side in sides.items() if limb in must and not self.measure.done(side))
        if not any(self.measure.done(side) for side in sides.values()):
            missing = missing or " or the ".join(sides.values())
        if missing:
            return f"hold the {missing} hand open for {self.measure.SECONDS:g} s first"
        if shutil.disk_usage(self.takes.path.parent).free < FREE_BYTES:
            return f"the disk of {self.takes.path.parent} is full: free {FREE_BYTES // 1_000_000} MB first"
        return ""

    def _take(self) -> None:
        self._phase, self._command, self.discarded = "waiting", None, False
        lengths = self.measure.lengths_m()
        plan = self.plan
        live = LiveOperator(self.environment, self.own, lengths, plan.retargeting, self.inbox, self._check, plan.speed)
        self._live = live
        try:
            episode = self.driver.run(live, self._start, origin="operator", filters=FILTERS, observer=self)
            self._judge(episode, Kept(self._seed, live.rows, lengths, live.sides()))
        except Ended as ended:
            self._told = str(ended)
        finally:
            self._live = None
        self._phase = "ready"
        self._draw()

    def _judge(self, episode: Episode, kept: Kept) -> None:
        if not episode.success:
            self._told = f"not kept: {episode.reason}"
            return
        try:
            for hand in seen(kept):
                points = np.array([message.positions[hand] for _, message in kept.rows], np.float64)
                motion.check_side(points[np.isfinite(points).all(axis=(1, 2))], hands.SIDES[hand])
        except RuleError as error:
            self._told = f"not kept: {error.message}"
            return
        self.takes.add(kept)
        self._numbers.append(self._number)
        self._number += 1
        seconds = len(episode.joints) * self.environment.period_s
        self._told = f"take {len(self.takes.kept)} kept, {seconds:.1f} s"
        if self.takes.unsaved:
            self._told += f", but not written: {self.takes.unsaved}"

    def _check(self) -> None:
        """End the take by a wish, or because nothing comes any more."""
        wishes = self._wished()
        if "end" in wishes:
            # The session ends after the take, which has not done the task.
            self.discarded = True
            self.wish("end")
        if "end" in wishes or "discard" in wishes:
            raise Ended("discarded")
        if "finish" in wishes and self._live:
            self._live.finish()
        live = self._live
        rows = live.rows if live else []
        if not rows and time.perf_counter() - self._preview > IDLE_S:
            self._preview = time.perf_counter()
            self._show()
        if live and rows and self._quiet_s() > LOST_S and not live.finishing:
            raise Ended(f"the connection was silent for {LOST_S:g} s, so the take was stopped")

    def _quiet_s(self) -> float:
        """Time since a message came [s], which a step of a slow simulation has perhaps not read yet."""
        return time.perf_counter() - self.inbox.arrived

    def sent(self, command: Command) -> None:
        """Measure the delay of the message behind a command; see `drive.Observer`."""
        self._command = command
        live = self._live
        if live and live.used is not None and live.used is not self._sent:
            self._sent = self._last = live.used
            self.own_share.add([1000 * (time.perf_counter() - live.used.arrived)])
            self.processor.add([1000 * (time.thread_time() - live.heard)])

    def stepped(self, outcome: Outcome) -> None:
        """Show the state after a control period; see `drive.Observer`."""
        self._phase = "taking"
        self._show(success=outcome.success)

    def _show(self, *, success: bool = False) -> None:
        data, live = self.environment.data, self._live
        joints = np.concatenate([self._hands_drawn().ravel(), self._ghosts().ravel()])
        facts = {
            "phase": self._phase,
            "told": self._told,
            "kept": len(self.takes.kept),
            "takes": self.plan.takes,
            "seconds": round(self.environment.steps * self.environment.period_s, 2),
            "limit": self.environment.task.timeout_s,
            "success": success,
            "held": {limb: bool(held) for limb, held in live.held.items()} if live else {},
            "clutch": [bool(each) for each in self._last.clutch] if self._last else [False, False],
            "tracked": [bool(each > LOST) for each in self._last.tracking] if self._last else [False, False],
            "measured": [round(self.measure.share(side), 2) for side in hands.SIDES],
            "silent": bool(live and live.rows and self._quiet_s() > SILENT_S),
            "limits": self._limits(),
            "lag_mm": round(1000 * self.driver.control.lag_m(self._command), 1) if live and self._command else 0.0,
            "own_ms": [round(each, 1) for each in self.own_share.percentiles()] if len(self.own_share) else None,
            "used": self._sent.number if self._sent and live else None,
            "late": live.late if live else 0,
            "dropped": self.inbox.dropped,
            "heading": self.heading_rad,
            "scales": dict(self._scales),
            "unsaved": self.takes.unsaved,
            "camera": self.camera,
        }
        self._publish(protocol.state(facts, data.xpos, data.xquat, joints))

    def _limits(self) -> list[str]:
        """Joints whose targets are at their limits, and links that would come too near to each other."""
        target, near = self.environment.previous_action, 1e-3
        at = (target <= self.environment.lower + near) | (target >= self.environment.upper - near)
        arms = {name for limb in self.environment.bundle.robot.limbs.values() for name in limb.arm}
        joints = self.environment.bundle.robot.joints
        stopped = [joint.name for joint, met in zip(joints, at, strict=True) if met and joint.name in arms]
        pairs = self.driver.control.met(self._command) if self._live and self._command else []
        return stopped + [f"{one} near {other}" for one, other in pairs]

    def _hands_drawn(self) -> np.ndarray:
        """Joints (2, 25, 3) of the operator's hands in the base; NaN is sent as it is."""
        return np.full((2, 25, 3), np.nan) if self._last is None else self._last.positions

    def _ghosts(self) -> np.ndarray:
        """Poses (G, 7) in the base of the links of hands at their targets; NaN if nothing drives them."""
        parts = []
        for limb, own in self.own.items():
            aim = self._live.aims.get(limb) if self._live else None
            if aim is None:
                parts.append(np.full((len(own.hand.links), 7), np.nan))
                continue
            parts.append(own.hand.link_poses(aim.fingers, aim.palm))
        return np.concatenate(parts) if parts else np.zeros((0, 7))


def _moved_together(limbs: Iterable[str], must: set[str]) -> Iterator[tuple[str, ...]]:
    """Limbs that an operator's hands may move in one take, in the order of `limbs`, those of `must` among them."""
    every = tuple(limbs)
    for count in range(1, len(every) + 1):
        yield from (some for some in combinations(every, count) if must <= {*some})
