"""Running a policy: one deployable observation in, one set of joint targets out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

import numpy as np

from dextera_build.artifacts.tasks.policy import Channel, Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.policy import cameras
from dextera_build.policy.features import Fields, Reader, measured, observed
from dextera_build.policy.layout import WORLD, Layout, world_flag
from dextera_build.policy.observation import DeployableObservation

Predict = Callable[[Fields, int], np.ndarray]
"""Inputs, one sample of each, and the number of steps since the start of the episode, 0 at its first, to joint targets
(C, A) float64 [rad] for this step and the C - 1 after it. `rgb` comes as (1, H, W, 3) uint8, `depth` and `cloud` as
`features.measured` gives them, the others as `Reader` does. If the contract's setting `history` is T > 1, each has T
samples in one: (1, T, ...), the present one last; before the first step, the first is repeated. A recurrent policy
forgets what it holds at step 0."""
PICTURES = {"rgb": "picture", "depth": "depth picture", "cloud": "point cloud"}
"""Term of a camera -> its name in errors."""


class Runner(Protocol):
    """Interface of `policy.py` of an algorithm: `rules/learn/act/policy.py` for the checkpoints of `learn.act`."""

    def predict(self, checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
        """The network of a checkpoint, ready to run in a task bundle; its contract was found to fit.

        Raises:
            RuleError: The weights are corrupt.
        """
        ...


class PolicyFault(RuleError):  # noqa: N818 - the fault is the policy's, not dxb's
    """A policy's output cannot be sent to a robot; the trial has failed, the evaluation continues."""


class Ensemble:
    """Joint targets from overlapping chunks (temporal ensembling, Zhao et al. 2023).

    All chunks that include the current step are averaged with weights exp(-forget * i), i = 0 for the oldest.

    Args:
        every: Number of steps between new chunks; 1: a chunk at every step.
        forget: Decay of the weights; 0: equal weights, above 0: the oldest has most weight, below 0: the newest.
    """

    def __init__(self, every: int, forget: float) -> None:
        self.every = every
        self.forget = forget
        self._chunks: list[np.ndarray] = []

    def due(self, step: int) -> bool:
        """Whether a new chunk is needed at `step`."""
        return step % self.every == 0 or not self._chunks

    def add(self, chunk: np.ndarray) -> None:
        """Add a chunk (C, A) that begins at the current step."""
        self._chunks.append(chunk)

    def take(self) -> np.ndarray:
        """Return the targets (A,) for the current step, and advance the chunks by one."""
        weights = np.exp(-self.forget * np.arange(len(self._chunks)))
        mean = np.einsum("n,na->a", weights, np.stack([chunk[0] for chunk in self._chunks])) / weights.sum()
        self._chunks = [chunk[1:] for chunk in self._chunks if len(chunk) > 1]
        return np.asarray(mean)


class Policy:
    """A trained policy that runs in one world.

    Args:
        contract: Inputs and outputs.
        layout: The layout of the world, which matches the contract.
        predict: The network.
        limits: Joint limits (A, 2) [rad].
    """

    def __init__(self, contract: PolicyContract, layout: Layout, predict: Predict, limits: np.ndarray) -> None:
        self.contract = contract
        self._reader = Reader(contract.inputs, layout)
        self._world = world_flag(layout.world)[None]
        self._predict = predict
        self._limits = limits
        self.reset()

    def reset(self) -> None:
        """Clear the state of the previous episode."""
        settings = self.contract.settings
        self._step = 0
        self._seen: deque[Fields] = deque(maxlen=self.contract.history)
        self._ensemble = Ensemble(int(settings.get("every", 1)), float(settings.get("forget", 0.0)))

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) float64 [rad], within limits, in the order of the contract's action.

        Raises:
            PolicyFault: The observation or the network's answer is not finite, or the picture has another size.
        """
        due = self._ensemble.due(self._step)
        if due or self._seen.maxlen != 1:
            self._seen.append(self._inputs(observation))
        if due:
            self._ensemble.add(self._finite(self._predict(self._recent(), self._step)))
        targets = self._ensemble.take()
        self._step += 1
        return np.asarray(np.clip(targets, self._limits[:, 0], self._limits[:, 1]))

    def chunk(self, *observations: DeployableObservation, step: int | None = None) -> np.ndarray:
        """Joint targets (C, A) float64 [rad], not limited, for a program that carries them out in place of `act`.

        Args:
            observations: The present one, after those before it that a policy with a history has not seen yet.
            step: Number of steps since the start of the episode; None: the program asks again when `act` would, or, if
                it gives less than the history of a policy, as soon as it has as many observations again.

        Raises:
            PolicyFault: An observation or the network's answer is not finite, or the picture has another size.
        """
        self._step = self._step if step is None else step
        self._seen.extend(self._inputs(each) for each in observations)
        made = self._finite(self._predict(self._recent(), self._step))
        whole = len(observations) >= self.contract.history
        self._step += self._ensemble.every if whole else len(observations)
        return made

    def _recent(self) -> Fields:
        """The observations that the network takes."""
        if self._seen.maxlen == 1:
            return self._seen[0]
        missing = (self._seen.maxlen or 0) - len(self._seen)
        seen = [self._seen[0]] * missing + list(self._seen)
        return {name: np.stack([each[name] for each in seen], axis=1) for name in seen[-1]}

    def _inputs(self, observation: DeployableObservation) -> Fields:
        fields = {WORLD: self._world} | observed(observation)
        inputs = self._reader.read(fields)
        bad = [name for name, samples in inputs.items() if not np.isfinite(samples).all()]
        if bad:
            raise PolicyFault(f"the policy was given NaN in `{bad[0]}` at step {self._step}", code="DXB-B509")
        return inputs | {channel.name: self._picture(channel, fields) for channel in self.contract.seen}

    def _picture(self, channel: Channel, fields: Fields) -> np.ndarray:
        wanted, term = channel.shape, cameras.term_of(channel.name)
        what = PICTURES.get(term, "picture")
        what += "" if channel.name == term else f" of camera `{cameras.camera_of(channel.name)}`"
        picture = fields.get(channel.name)
        if picture is None or picture.shape[1:] != wanted:
            shown = f"no {what}" if picture is None else f"a {what} {picture.shape[1:]}"
            raise PolicyFault(f"the policy was given {shown} at step {self._step}, it needs {wanted}", code="DXB-B510")
        return picture if channel.encoding == "picture" else measured(channel, picture)

    def _finite(self, chunk: np.ndarray) -> np.ndarray:
        if not np.isfinite(chunk).all():
            raise PolicyFault(f"the policy gave NaN at step {self._step}", code="DXB-B511")
        return chunk
