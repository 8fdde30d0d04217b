"""A policy that answers in a thread of its own: late answers neither stop the robot nor make it jump."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.deploying.ahead import Ahead, Chunked
from dextera_build.deploying.cell import Safety
from dextera_build.policy.observation import DeployableObservation
from dextera_build.policy.running import Ensemble
from tests.deploying.robots import Lifting, Rig

STEPS = 12
"""Steps of a chunk."""


class Late(Future[np.ndarray]):
    """An answer that comes at a virtual time."""

    def __init__(self, rig: Rig, made: np.ndarray, ready: int) -> None:
        super().__init__()
        self._rig, self._made, self._ready = rig, made, ready

    def done(self) -> bool:
        return self._rig.time >= self._ready

    def result(self, timeout: float | None = None) -> np.ndarray:
        while not self.done():
            self._rig.sleep(0.01)
        return self._made


@dataclass
class Slow:
    """A worker whose every answer takes as long as told, the last time again and again [s]."""

    rig: Rig
    takes_s: list[float]

    def submit(self, function: Callable[..., np.ndarray], /, *args: Any) -> Future[np.ndarray]:
        takes = self.takes_s.pop(0) if len(self.takes_s) > 1 else self.takes_s[0]
        return Late(self.rig, function(*args), self.rig.time + round(takes * 1e9))


class Chunks(Lifting):
    """`Lifting` in chunks: what it wants depends on the time alone."""

    def chunk(self, *observations: DeployableObservation, step: int) -> np.ndarray:
        first = self.steps + len(observations) - 1
        assert step == first, "the network is told the step of the observation"
        self.steps = first
        made = np.array([self.act(observations[-1]) for _ in range(STEPS)])
        self.steps = first + 1
        return made


class Lagging:
    """Goes on from where the robot is measured, which lags behind its commands, as imitated policies do."""

    def reset(self) -> None: ...

    def chunk(self, *observations: DeployableObservation, step: int) -> np.ndarray:
        ahead = np.arange(1, STEPS + 1)[:, None] * np.array([0.004, 0, 0, 0, 0])
        return np.asarray(observations[-1]["joints"] - [0.02, 0, 0, 0, 0] + ahead)


def ahead(rig: Rig, policy: Any, *takes_s: float, every: int = 6) -> Ahead:
    return Ahead(
        policy,
        lambda: rig.cell.previous_action,
        rate_hz=20.0,
        chunked=Chunked(every),
        answer_s=0.5,
        now=lambda: rig.time,
        worker=Slow(rig, [*takes_s]),
    )


def sent(rig: Rig, policy: Any, limit_s: float = 3.0) -> tuple[Any, np.ndarray]:
    """What happened, and the targets that were sent."""
    found: list[np.ndarray] = []
    send = rig.cell.send

    def noted(targets: np.ndarray) -> np.ndarray:
        found.append(send(targets))
        return found[-1]

    rig.cell.send = noted  # type: ignore[method-assign]
    return rig.drive(policy, limit_s), np.array(found)


@pytest.mark.medium
def test_late_answers_change_nothing_that_is_sent() -> None:
    here, there = Rig(), Rig()
    for rig in (here, there):
        rig.sleep(3.0)  # the arm sags at first
    together, wanted = sent(here, Lifting(), 12.0)
    policy = ahead(there, Chunks(), 0.2)
    apart, found = sent(there, policy, 12.0)
    assert (together.success, apart.success) == (True, True)
    assert (apart.missed, policy.waited) == (1, 0)  # the first command waits for the first answer
    assert max(apart.jitter_s) == 0.0
    count = min(len(found), len(wanted))  # poses come at their own rate, so that success is seen a period later
    assert abs(len(found) - len(wanted)) <= 2
    # While the guard ramps in, commands are not what was wanted, and chunks begin at what was sent.
    assert found[40:count] == pytest.approx(wanted[40:count], abs=1e-6)
    assert found[:40] == pytest.approx(wanted[:40], abs=0.01)
    told = policy.facts()
    assert told["answer_ms_p50"] == pytest.approx(200.0, abs=11)
    assert 200.0 <= told["age_ms_p99"] <= 1000 * STEPS / 20


def test_a_new_chunk_begins_at_the_last_command() -> None:
    rig = Rig()
    _, found = sent(rig, ahead(rig, Lagging(), 0.1))
    steps = np.diff(found[:, 0])
    jump = 0.02  # by which a chunk begins behind the one before
    assert len(steps) == 59
    assert np.abs(steps).max() < 0.004 + jump / 4
    assert np.abs(steps).max() < jump / 2


def test_overlapping_answers_are_averaged_as_without_a_thread() -> None:
    rig = Rig(safety=Safety(ramp_s=0.0))
    drift = np.arange(STEPS)[:, None] * np.array([0.002, 0, 0, 0, 0])  # every answer is wrong farther ahead

    class Drifting:
        def reset(self) -> None: ...

        def chunk(self, *observations: DeployableObservation, step: int) -> np.ndarray:
            return np.add([0.03, -0.02, 0.05, 0.04, 0.04], drift)

    _, found = sent(rig, ahead(rig, Drifting(), 0.04, every=1), 4.0)
    together = Ensemble(1, 0.0)
    for _ in range(STEPS):
        together.add(Drifting().chunk(step=0))
        wanted = together.take()
    assert wanted[0] == pytest.approx(0.03 + 0.002 * (STEPS - 1) / 2)
    # An answer is a control period old when it arrives, which is half a period of drift in the mean.
    assert found[-1] == pytest.approx(wanted, abs=0.0011)


def test_steps_that_are_used_up_are_counted_and_the_robot_holds() -> None:
    rig = Rig()
    policy = ahead(rig, Chunks(), 0.05, 0.05, 0.45, 0.05, every=STEPS)
    ran, found = sent(rig, policy)
    assert not ran.faulty, ran.reason
    assert policy.waited > 0
    assert (np.diff(found, axis=0) == 0).all(axis=1).sum() >= policy.waited


def test_a_policy_that_hangs_stops_the_robot() -> None:
    rig = Rig()
    ran, _ = sent(rig, ahead(rig, Chunks(), 0.05, 0.05, 60.0))
    assert ran.faulty
    assert "the policy gave no answer in 0.5" in ran.reason
    assert rig.robot.heard.after_stop == 0


def test_answers_that_are_too_short_for_their_time_are_refused() -> None:
    rig = Rig()

    class Single(Chunks):
        def chunk(self, *observations: DeployableObservation, step: int) -> np.ndarray:
            return super().chunk(*observations, step=step)[:1]

    ran, _ = sent(rig, ahead(rig, Single(), 0.1))
    assert ran.faulty
    assert ran.reason == "an answer of 1 steps came 2 control periods after its measurement"


def test_a_failure_in_the_thread_is_that_of_the_run() -> None:
    rig = Rig()

    class Broken(Chunks):
        def chunk(self, *observations: DeployableObservation, step: int) -> np.ndarray:
            if self.steps > 10:
                raise ZeroDivisionError("by zero")
            return super().chunk(*observations, step=step)

    policy = Ahead(
        Broken(), lambda: rig.cell.previous_action, rate_hz=20.0, chunked=Chunked(6), answer_s=0.5, now=time.time_ns
    )
    with pytest.raises(ZeroDivisionError):
        sent(rig, policy)
    assert rig.robot.heard.status[-1] == "stopped: ZeroDivisionError: by zero"


def test_a_policy_is_given_no_more_observations_than_it_takes() -> None:
    rig, given = Rig(), list[int]()

    class Counts(Lagging):
        def chunk(self, *observations: DeployableObservation, step: int) -> np.ndarray:
            given.append(len(observations))
            return super().chunk(*observations, step=step)

    cell, policy = rig.cell, Counts()
    asked = Ahead(
        policy,
        lambda: cell.previous_action,
        rate_hz=20.0,
        chunked=Chunked(6, history=2),
        answer_s=0.5,
        now=lambda: rig.time,
        worker=Slow(rig, [0.0]),
    )
    rig.drive(asked, limit_s=2.0)
    assert max(given) == 2
    assert len(given) > 5
