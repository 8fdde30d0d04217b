"""Drives a robot by a policy: one observation and one command in each control period, until it is done or stopped."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying.cell import RosCell, Sleep
from dextera_build.errors import DxbError
from dextera_build.formats.ros.reading import SECOND
from dextera_build.policy.added import AddedTerms
from dextera_build.policy.layout import embodiment
from dextera_build.policy.observation import DeployableObservation, deployable
from dextera_build.policy.robot_run import STOPPED
from dextera_build.version import __version__

DONE = "the task is done"
LATE = "not done within {:g} s"


class Acting(Protocol):
    """A policy."""

    def reset(self) -> None:
        """Clear state from the previous run."""

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) [rad or m]."""


@dataclass
class Drive:
    """What happened in a run."""

    reason: str = ""
    """Why it ended."""
    faulty: bool = False
    """Whether it was stopped: by the guard, a fault of the policy or the operator."""
    success: bool | None = None
    """Whether the last measurement shows success; None: not all objects were measured then, or at the beginning."""
    steps: int = 0
    """Number of control periods."""
    missed: int = 0
    """Number of control periods whose command was sent late, by more than half a period."""
    interventions: int = 0
    """Number of control periods in which the guard changed targets."""
    delays_s: list[float] = field(default_factory=list)
    """See `RosCell.delays_s`."""
    jitter_s: list[float] = field(default_factory=list)
    """Differences of the time between two commands from the control period [s]."""

    def facts(self) -> dict[str, Any]:
        """As plain data, with times in milliseconds."""
        return {
            "reason": self.reason,
            "success": self.success,
            "steps": self.steps,
            "missed_periods": self.missed,
            "interventions": self.interventions,
            **quantiles("delay", self.delays_s),
            **quantiles("jitter", self.jitter_s),
        }


def quantiles(what: str, times_s: list[float]) -> dict[str, float | None]:
    """Median and 99th percentile of times, `delay_ms_p50` and `delay_ms_p99`; None without any."""
    return {
        f"{what}_ms_p{share}": round(1000 * float(np.quantile(times_s, share / 100)), 2) if times_s else None
        for share in (50, 99)
    }


@dataclass(frozen=True)
class Clock:
    """Pace of a run."""

    now: Callable[[], int] = time.monotonic_ns
    """The time [ns], which nobody sets."""
    sleep: Sleep = time.sleep
    """Waits [s]."""


def drive(
    cell: RosCell,
    policy: Acting,
    goal: np.ndarray,
    *,
    rate_hz: float,
    limit_s: float,
    added: AddedTerms | None = None,
    clock: Clock = Clock(),
    halt: threading.Event | None = None,
) -> Drive:
    """Run a policy until the measurements show success, the time is over, or something is wrong.

    Args:
        cell: The robot.
        policy: Receives only deployable observations.
        goal: Goal (G,).
        rate_hz: Control rate [Hz].
        limit_s: Time limit [s].
        added: Terms that do not come with dxb.
        clock: Time.
        halt: Set by the operator to stop.
    """
    ran, sent, period = Drive(), list[int](), round(SECOND / rate_hz)
    try:
        # The first answer may take seconds, in which libraries are loaded; it is not carried out.
        policy.reset()
        cell.offer()
        policy.act(deployable(cell.begin(), cell.previous_action, goal, added))
        policy.reset()
        measured = cell.begin()
        cell.tell("running")
        ran.success = False if cell.judges else None
        due = clock.now()
        while True:
            targets = policy.act(deployable(measured, cell.previous_action, goal, added))
            _heed(halt, cell)  # also while the policy thought
            cell.send(targets)
            ran.steps += 1
            sent.append(clock.now())
            # Commands that follow closely would exceed the speed limits, so that time is not made up.
            late = sent[-1] - due > period // 2
            ran.missed += late
            due = _next(clock, (sent[-1] if late else due) + period)
            measured = cell.measure()
            ran.success = cell.judge(measured, ran.steps / rate_hz)
            if ran.success or ran.steps >= limit_s * rate_hz:
                ran.reason = DONE if ran.success else LATE.format(limit_s)
                break
    except DxbError as fault:
        ran.reason, ran.faulty = fault.message, True
    except KeyboardInterrupt:
        ran.reason, ran.faulty = cell.stop("the operator stopped it").message, True
    except Exception as error:
        cell.tell(f"{STOPPED}{type(error).__name__}: {error}")
        raise
    ran.interventions, ran.delays_s = cell.interventions, cell.delays_s
    ran.jitter_s = [abs(later - earlier - period) / SECOND for earlier, later in itertools.pairwise(sent)]
    cell.tell(STOPPED + ran.reason)
    return ran


def facts(cell: RosCell, bundle: TaskBundle) -> dict[str, str]:
    """What a recording says of its run, whatever commands the robot."""
    return {
        "dxb": __version__,
        "task": bundle.task.name,
        "embodiment": embodiment(bundle.robot),
        "world": cell.world,
        "rate_hz": f"{cell.rate_hz:g}",
        "limits": cell.safety.limits.model_dump_json(),
        "ramp_s": f"{cell.safety.ramp_s:g}",
    }


def _heed(halt: threading.Event | None, cell: RosCell) -> None:
    """Raise if the operator stops the run."""
    if halt is not None and halt.is_set():
        raise cell.stop("the operator stopped it")


def _next(clock: Clock, due: int) -> int:
    """Wait until a time [ns], and return it."""
    left = due - clock.now()
    if left > 0:
        clock.sleep(left / SECOND)
    return due
