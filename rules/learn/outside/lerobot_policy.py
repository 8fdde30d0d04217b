"""A policy of LeRobot, run by LeRobot in its own environment and asked at every step."""

from __future__ import annotations

import json
import shutil
import tempfile
import weakref
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import RuleError
from dextera_build.learning import packed
from dextera_build.policy.features import Fields
from dextera_build.rule.standing import StandingProgram

from .programs import lerobot_acting  # its source is part of what runs a checkpoint


class Lerobot:
    """A policy of LeRobot in a process of its own, which ends with this object.

    Args:
        checkpoint: Of learn.lerobot.

    Raises:
        MachineError: LeRobot's environment is missing here.
        RuleError: The weights are corrupt.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        self._settings: dict[str, Any] = dict(checkpoint.contract.settings)
        self._features: dict[str, list[str]] = json.loads(self._settings["features"])
        self._shapes = {channel.name: channel.shape for channel in checkpoint.contract.inputs}
        self._joints = checkpoint.contract.action.shape[0]
        script = Path(lerobot_acting.__file__ or "")
        self._program = StandingProgram("a policy of learn.lerobot", script, ".envs/lerobot", "envs/lerobot.lock")
        self._folder = Path(tempfile.mkdtemp(prefix="dxb-lerobot-"))
        weakref.finalize(self, _close, self._program, self._folder)
        packed.unpack(checkpoint.weights, self._folder)

    def __call__(self, inputs: Fields, step: int) -> np.ndarray:
        """Joint targets (1, A) for this step [rad].

        Args:
            inputs: One sample of each channel.
            step: Steps since the start of the episode.

        Raises:
            RuleError: LeRobot failed, or gave something else.
        """
        targets = self._program.ask(
            "act",
            np.ndarray,
            folder=str(self._folder),
            version=self._settings["version"],
            instruction=self._settings["instruction"],
            seed=self._settings["seed"],
            reset=step == 0,
            observation={name: self._feature(parts, inputs) for name, parts in self._features.items()},
        )
        if targets.shape != (self._joints,):
            raise RuleError(
                f"LeRobot's policy gave {targets.shape}, the robot has {self._joints} joints",
                code="DXB-B532",
                hint="train on a data set of this task",
            )
        return np.array(targets[None])

    def _feature(self, channels: list[str], inputs: Fields) -> np.ndarray:
        """A feature (N,) float32, or a picture (H, W, 3) uint8, as the data set has it."""
        parts = [np.asarray(inputs[name]).reshape(self._shapes[name]) for name in channels]
        if len(parts) == 1 and parts[0].dtype == np.uint8:
            return np.ascontiguousarray(parts[0])
        return np.concatenate([part.ravel() for part in parts]).astype(np.float32)


def _close(program: StandingProgram, folder: Path) -> None:
    program.end()
    shutil.rmtree(folder, ignore_errors=True)
