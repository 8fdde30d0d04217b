"""A policy that answers in a thread of its own while the steps of its last answer are carried out.

The robot does not wait for the network: a chunk that was asked for at step s and arrives at step t counts from its
step t - s on. Chunks that reach the present step are averaged as in `policy.running.Ensemble` (Zhao et al. 2023). A new
chunk was predicted from another measurement, so that every change of chunks would be a jump [almond-bot/axol #191]:
among few others its weight grows, and one that follows on the last step of all others is shifted to begin at the last
command, and the shift fades out.

With `Continuing`, the policy is told with each question what is carried out until its answer can arrive, and the answer
continues that, so that the newest one alone is carried out: real-time chunking (Black et al. 2025).
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.deploying.cell import RosCell
from dextera_build.deploying.continuing import Continuing
from dextera_build.deploying.driving import quantiles
from dextera_build.errors import RuleError
from dextera_build.formats.ros.reading import SECOND
from dextera_build.policy.continuing import Plan
from dextera_build.policy.observation import DeployableObservation
from dextera_build.policy.running import Policy, PolicyFault

FADE_S = 0.25
"""Time in which the difference that a new chunk makes fades in [s]."""
PAST = 32
"""Number of steps before the present one of which a policy is told what was carried out, more than any observes."""


@dataclass(frozen=True)
class Answer:
    """A chunk that arrived."""

    targets: np.ndarray
    """The chunk (C, A) [rad or m]."""
    asked: int
    """Step of the observation behind it, the one of its first targets."""
    arrived: int
    """Step at which it arrived."""
    others: int
    """Number of chunks that reached that step, too."""

    def reaches(self, step: int) -> bool:
        """Whether it has targets for a step."""
        return step - self.asked < len(self.targets)

    def weight(self, step: int, fade: int) -> float:
        """From 0 to 1; it grows, so that the mean moves by at most 1 / `fade` of the difference a step."""
        return min(1.0, self.others * (step - self.arrived + 1) / max(1, fade - 1)) if self.others else 1.0


class Chunking(Protocol):
    """A policy that gives chunks."""

    def reset(self) -> None:
        """Clear state from the previous run."""

    def chunk(self, *observations: DeployableObservation, step: int) -> np.ndarray:
        """Joint targets (C, A) [rad or m] for `step`, that of the last observation, and those after it."""


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


@dataclass(frozen=True)
class Chunked:
    """How a policy gives chunks, by its contract."""

    every: int = 1
    """Number of steps of a chunk after which the next one is asked for, if its answer comes at once."""
    history: int | None = None
    """Number of observations that the policy takes; None: all since the last question."""
    forget: float = 0.0
    """Decay of the weights of overlapping chunks, see `Ensemble`."""

    @classmethod
    def of(cls, contract: PolicyContract) -> Chunked:
        """What a contract says."""
        settings = contract.settings
        return cls(int(settings.get("every", 1)), contract.history, float(settings.get("forget", 0.0)))


class Ahead:
    """Gives one set of joint targets per control period at once, from the chunks so far.

    Args:
        policy: Asked by one thread at a time.
        last: Joint targets (A,) that were sent last.
        rate_hz: Control rate [Hz].
        chunked: How the policy gives chunks.
        answer_s: Longest time of an answer, except the first after `reset` [s].
        now: The time [ns].
        worker: Runs the policy; None: a thread.
        continuing: Tells the policy what its answer has to continue; None: overlapping chunks are averaged.
    """

    def __init__(
        self,
        policy: Chunking,
        last: Callable[[], np.ndarray],
        *,
        rate_hz: float,
        chunked: Chunked,
        answer_s: float,
        now: Callable[[], int],
        worker: Submits | None = None,
        continuing: Continuing | None = None,
    ) -> None:
        self._policy, self._last, self._answer_s, self._now = policy, last, answer_s, now
        self._chunked, self._continuing = chunked, continuing
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
    def of(cls, policy: Policy, cell: RosCell, continuing: Continuing | None = None) -> Ahead:
        """A trained policy for a robot, with the limits of its cell."""
        return cls(
            policy,
            lambda: cell.previous_action,
            rate_hz=cell.rate_hz,
            chunked=Chunked.of(policy.contract),
            answer_s=cell.safety.answer_s,
            now=time.time_ns,
            continuing=continuing,
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
        if not self._chunks:
            self._ask()
            self._take(self._answer())
        elif self._asked is not None and self._asked.done():
            self._take(self._answer())
        elif self._asked is not None and (late_s := (self._now() - self._since) / SECOND) > self._answer_s:
            raise PolicyFault(f"the policy gave no answer in {late_s:.2f} s", code="DXB-B554")
        if self._asked is None and self._step - self._chunks[-1].asked >= self._due():
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
        self._chunks: list[Answer] = []
        """Oldest first."""
        self._unseen = deque[DeployableObservation](maxlen=self._chunked.history)
        self._step = self._asked_at = self._since = 0
        self._joined, self._shift = 0, np.zeros(0)
        self._carried: deque[np.ndarray] = deque(maxlen=PAST)

    def _delay(self) -> int:
        """Steps that are carried out before an answer arrives, if it takes as long as the slowest of the last ones."""
        return int(np.ceil(max(self.answers_s[-5:], default=0.0) * self._rate_hz))

    def _due(self) -> int:
        """Steps into a chunk after which the next one is asked for, so that it arrives before the last step."""
        return max(1, min(self._chunked.every, len(self._chunks[-1].targets) - self._delay() - 1))

    def _plan(self) -> Plan | None:
        """What the robot is told until the next answer arrives, and would be told after it."""
        if not self._chunks:
            return None
        left = self._chunks[-1].targets[self._step - self._chunks[-1].asked :]
        past = np.array(self._carried).reshape(len(self._carried), left.shape[1])
        return Plan(past, left, max(1, self._delay()))

    def _ask(self) -> None:
        if self._continuing is not None:
            self._continuing.plan = self._plan()
        self._asked = self._worker.submit(partial(self._policy.chunk, step=self._step), *self._unseen)
        self._unseen.clear()
        self._asked_at, self._since = self._step, self._now()

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
        first = not self._chunks
        self._chunks = [each for each in self._chunks if each.reaches(self._step)]
        if not self._chunks:
            self._joined = self._step
            self._shift = np.zeros(chunk.shape[1]) if first else self._last() - chunk[max(0, passed - 1)]
        elif self._continuing is not None:
            self._chunks.clear()  # the new one continues them
        self._chunks.append(Answer(chunk, self._asked_at, self._step, len(self._chunks)))

    def _target(self) -> np.ndarray:
        step = self._step
        self.ages_s.append((step - self._chunks[-1].asked) / self._rate_hz)
        self._step += 1
        found = [each for each in self._chunks if each.reaches(step)]
        if not found:
            self.waited += 1
            self._carried.append(self._last())
            return self._carried[-1]
        weights = np.exp(-self._chunked.forget * np.arange(len(found))) * [
            each.weight(step, self._fade) for each in found
        ]
        mean = weights @ np.stack([each.targets[step - each.asked] for each in found]) / weights.sum()
        left = max(0.0, 1.0 - (step - self._joined + 1) / self._fade)
        self._carried.append(np.asarray(mean + left * self._shift))
        return self._carried[-1]
