"""A policy that answers in a thread of its own while the steps of its last answer are carried out.

The robot does not wait for the network: a chunk that was asked for at step s and arrives at step t is carried out from
its step t - s on. It then begins away from the last command, because it was predicted from an older measurement, so
that every change of chunks would be a jump [almond-bot/axol #191]. It is therefore shifted to begin at the last
command, and the shift fades out.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol

import numpy as np

from dextera_build.deploying.cell import RosCell
from dextera_build.deploying.driving import quantiles
from dextera_build.errors import RuleError
from dextera_build.formats.ros.reading import SECOND
from dextera_build.policy.observation import DeployableObservation
from dextera_build.policy.running import Policy, PolicyFault

FADE_S = 0.25
"""Time in which the shift of a new chunk fades out [s]."""


class Chunking(Protocol):
    """A policy that gives chunks."""

    def reset(self) -> None:
        """Clear state from the previous run."""

    def chunk(self, *observations: DeployableObservation) -> np.ndarray:
        """Joint targets (C, A) [rad or m] for the step of the last observation and those after it."""


class Submits(Protocol):
    """Runs functions elsewhere, as `concurrent.futures` does."""

    def submit(self, function: Callable[..., np.ndarray], /, *args: Any) -> Future[np.ndarray]:
        """Run a function."""


class Threads:
    """Runs each function in a thread of its own, which does not keep the program from ending if it hangs."""

    def submit(self, function: Callable[..., np.ndarray], /, *args: Any) -> Future[np.ndarray]:
        """Run a function."""
        made: Future[np.ndarray] = Future()

        def run() -> None:
            try:
                made.set_result(function(*args))
            except BaseException as error:  # the run raises it
                made.set_exception(error)

        threading.Thread(target=run, name="policy", daemon=True).start()
        return made


class Ahead:
    """Gives one set of joint targets per control period at once, from the newest chunk.

    Args:
        policy: Asked by one thread at a time.
        last: Joint targets (A,) that were sent last.
        rate_hz: Control rate [Hz].
        every: Number of steps of a chunk after which the next one is asked for, if its answer comes at once.
        answer_s: Longest time of an answer, except the first after `reset` [s].
        now: The time [ns].
        worker: Runs the policy; None: a thread.
    """

    def __init__(
        self,
        policy: Chunking,
        last: Callable[[], np.ndarray],
        *,
        rate_hz: float,
        every: int,
        answer_s: float,
        now: Callable[[], int],
        worker: Submits | None = None,
    ) -> None:
        self._policy, self._last, self._every, self._answer_s, self._now = policy, last, every, answer_s, now
        self._rate_hz, self._fade = rate_hz, max(1, round(FADE_S * rate_hz))
        self._worker = worker or Threads()
        self.answers_s: list[float] = []
        """Time from each question to its answer [s]."""
        self.ages_s: list[float] = []
        """Time from the measurement behind each command to the command, by control periods [s]."""
        self.waited = 0
        """Number of control periods in which no step was left, so that the last command was sent again."""
        self._begin()

    @classmethod
    def of(cls, policy: Policy, cell: RosCell) -> Ahead:
        """A trained policy for a robot, with the limits of its cell."""
        return cls(
            policy,
            lambda: cell.previous_action,
            rate_hz=cell.rate_hz,
            every=int(policy.contract.settings.get("every", 1)),
            answer_s=cell.safety.answer_s,
            now=time.time_ns,
        )

    def reset(self) -> None:
        """Begin anew; an answer that is still to come is waited for and not used."""
        if self._asked is not None:
            self._asked.result()
        self._policy.reset()
        self.answers_s, self.ages_s, self.waited = [], [], 0
        self._begin()

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) [rad or m] of this control period.

        Raises:
            PolicyFault: The policy failed, or does not answer in time.
            RuleError: Its answers are shorter than the time that they take.
        """
        self._unseen.append(observation)
        if self._chunk is None:
            self._ask()
            self._take(self._answer())
        elif self._asked is not None and self._asked.done():
            self._take(self._answer())
        elif self._asked is not None and (late_s := (self._now() - self._since) / SECOND) > self._answer_s:
            raise PolicyFault(f"the policy gave no answer in {late_s:.2f} s", code="DXB-B554")
        if self._asked is None and self._step - self._first >= self._due():
            self._ask()
        return self._target()

    def facts(self) -> dict[str, Any]:
        """What happened, as plain data, with times in milliseconds."""
        return {
            "periods_without_a_step": self.waited,
            **quantiles("answer", self.answers_s),
            **quantiles("age", self.ages_s),
        }

    def _begin(self) -> None:
        self._asked: Future[np.ndarray] | None = None
        self._chunk: np.ndarray | None = None
        self._unseen: list[DeployableObservation] = []
        self._step = self._first = self._asked_at = self._since = 0
        self._joined, self._shift = 0, np.zeros(0)

    def _due(self) -> int:
        """Steps into a chunk after which the next one is asked for, so that it arrives before the last step."""
        assert self._chunk is not None
        lead = int(np.ceil(max(self.answers_s[-5:], default=0.0) * self._rate_hz)) + 1
        return max(1, min(self._every, len(self._chunk) - lead))

    def _ask(self) -> None:
        self._asked = self._worker.submit(self._policy.chunk, *self._unseen)
        self._unseen, self._asked_at, self._since = [], self._step, self._now()

    def _answer(self) -> np.ndarray:
        assert self._asked is not None
        found = self._asked.result()
        self._asked = None
        self.answers_s.append((self._now() - self._since) / SECOND)
        return found

    def _take(self, chunk: np.ndarray) -> None:
        """Carry out a chunk from the present step on."""
        passed = self._step - self._asked_at
        if passed >= len(chunk):
            raise RuleError(
                f"an answer of {len(chunk)} steps came {passed} control periods after its measurement",
                code="DXB-B555",
                hint="run it without `--asynchronous`, at a lower rate, or on a faster machine",
            )
        if self._chunk is not None:
            self._shift, self._joined = self._last() - chunk[max(0, passed - 1)], self._step
        else:
            self._shift = np.zeros(chunk.shape[1])
        self._chunk, self._first = chunk, self._asked_at

    def _target(self) -> np.ndarray:
        assert self._chunk is not None
        row = self._step - self._first
        self.ages_s.append(row / self._rate_hz)
        left = max(0.0, 1.0 - (self._step - self._joined + 1) / self._fade)
        self._step += 1
        if row >= len(self._chunk):
            self.waited += 1
            return self._last()
        return np.asarray(self._chunk[row] + left * self._shift)
