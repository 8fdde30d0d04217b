"""Runs policies of learn.diffusion: the executed steps of a denoised window of actions [rad]."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import reproducible, running
from dextera_build.policy.continuing import Plan
from dextera_build.policy.features import Fields
from dextera_build.policy.running import Predict

from . import inpainting, network, schedule


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """The network of a checkpoint, ready to run in a task bundle."""
    return Denoised(checkpoint)


class Denoised:
    """A network that is asked for windows of actions.

    Args:
        checkpoint: Its weights and contract.

    Raises:
        RuleError: The weights are corrupt.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        self._contract = checkpoint.contract
        self._network = running.filled(network.of_contract(self._contract), checkpoint)
        self._present, self._every = self._network.history - 1, int(self._contract.settings["every"])
        self._noise = running.Noise(int(self._contract.settings["seed"]))

    def __call__(self, inputs: Fields, step: int) -> np.ndarray:
        """Joint targets (C, A) for this step and those after it [rad], as many as are executed."""
        with reproducible.one_thread(), torch.inference_mode():
            window = self._network.sample(running.tensors(inputs), self._drawn(inputs, step))
        return self._targets(window)[: self._every]

    def continued(self, inputs: Fields, step: int, plan: Plan | None) -> np.ndarray:
        """Joint targets (C, A) for this step and all those after it in the window [rad], which continue a plan."""
        with reproducible.one_thread(), torch.inference_mode():
            made, noise, seen = self._network, self._drawn(inputs, step), running.tensors(inputs)
            window = made.sample(seen, noise) if plan is None else self._inpainted(seen, noise, plan)
        return self._targets(window)

    def _drawn(self, inputs: Fields, step: int) -> Tensor:
        return torch.randn(1, *self._network.shape, generator=self._noise.at(inputs, step))

    def _targets(self, window: Tensor) -> np.ndarray:
        """Joint targets (C, A) of a normalised window (1, T, A), from the present step on [rad]."""
        return running.targets(self._contract, window[0, self._present :])

    def _inpainted(self, inputs: dict[str, Tensor], noise: Tensor, plan: Plan) -> Tensor:
        """A normalised window (1, T, A) that keeps to a plan."""
        made = self._network
        observed, _ = made.observe(inputs)

        def told(actions: Tensor, level: int) -> Tensor:
            found: Tensor = made(actions, torch.full((1,), level), observed)
            return found

        known, weights = self._known(plan)
        corrected = inpainting.kept(told, made.told, made.share, known, weights)
        window = schedule.denoised(noise, made.share, made.passes, corrected, "sample")
        return window * made.reach + made.centre

    def _known(self, plan: Plan) -> tuple[Tensor, Tensor]:
        """The window (1, T, A) of a plan, in -1 to 1, and the weights (1, T, 1) of its steps."""
        horizon, actions = self._network.shape
        targets, weights = np.zeros((horizon, actions)), np.zeros(horizon)
        past, ahead = plan.past[len(plan.past) - min(len(plan.past), self._present) :], plan.ahead
        first, end = self._present - len(past), self._present + len(ahead)
        targets[first:end] = np.concatenate([past, ahead])
        weights[first : self._present] = 1.0
        weights[self._present : end] = plan.weights()
        mean, scale = (np.array(part) for part in (self._contract.action.mean, self._contract.action.scale))
        normalised = torch.from_numpy(((targets - mean) / scale).astype(np.float32))
        known = ((normalised - self._network.centre) / self._network.reach).clamp(-1.0, 1.0)
        return known[None], torch.from_numpy(weights.astype(np.float32))[None, :, None]
