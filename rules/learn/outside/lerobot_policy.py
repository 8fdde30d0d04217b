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
from dextera_build.formats import exchange
from dextera_build.learning import packed
from dextera_build.outside import messages
from dextera_build.outside.program import Program
from dextera_build.outside.running import Limits, Running
from dextera_build.policy.features import Fields

from .programs import lerobot_acting  # its source is part of what runs a checkpoint

ENVIRONMENT = ".envs/lerobot"
LOCK = "envs/lerobot.lock"
_LIMITS = Limits(timeout_s=600.0, memory_gb=0.0, disk_gb=16.0, idle_s=86_400.0)
"""Of an answer; the first one loads the policy."""


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
        program = _program()
        program.check(program.digests())
        self._folder = Path(tempfile.mkdtemp(prefix="dxb-lerobot-"))
        self._running = program.run({}, (), gpu=False)
        weakref.finalize(self, _close, self._running, self._folder)
        packed.unpack(checkpoint.weights, self._folder)

    def __call__(self, inputs: Fields, step: int) -> np.ndarray:
        """Joint targets (1, A) for this step [rad].

        Args:
            inputs: One sample of each channel.
            step: Steps since the start of the episode.

        Raises:
            RuleError: LeRobot failed, or gave something else.
        """
        given = {
            "folder": str(self._folder),
            "version": self._settings["version"],
            "instruction": self._settings["instruction"],
            "seed": self._settings["seed"],
            "reset": step == 0,
            "observation": {name: self._feature(parts, inputs) for name, parts in self._features.items()},
        }
        targets = _asked(self._running, given)
        if targets.shape != (self._joints,):
            raise RuleError(
                f"LeRobot's policy gave {targets.shape}, the robot has {self._joints} joints",
                code="DXB-B543",
                hint="train on a data set of this task",
            )
        return targets[None]

    def _feature(self, channels: list[str], inputs: Fields) -> np.ndarray:
        """A feature (N,) float32, or a picture (H, W, 3) uint8, as the data set has it."""
        parts = [np.asarray(inputs[name]).reshape(self._shapes[name]) for name in channels]
        if len(parts) == 1 and parts[0].dtype == np.uint8:
            return np.ascontiguousarray(parts[0])
        return np.concatenate([part.ravel() for part in parts]).astype(np.float32)


def _asked(running: Running, given: dict[str, Any]) -> np.ndarray:
    folder = running.exchange()
    try:
        request = folder / messages.REQUEST
        messages.write(
            messages.Request(
                protocol=messages.PROTOCOL,
                rule="learn.lerobot",
                backend="acting",
                function="act",
                inputs={name: exchange.write(value, request, name) for name, value in given.items()},
            ),
            request,
        )
        running.ask(folder, lambda kind, data: None)
        answer = messages.read(folder / messages.RESPONSE)
        if isinstance(answer, messages.Refused):
            raise RuleError(answer.message, code="DXB-B378", hint=answer.hint or None, facts={"said by": "LeRobot"})
        return np.array(exchange.read(answer.output, np.ndarray, folder / messages.RESPONSE))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _program() -> Program:
    """LeRobot in the environment of the project that contains the current folder."""
    here = Path.cwd()
    base = next((folder for folder in (here, *here.parents) if (folder / ENVIRONMENT).exists()), here)
    return Program(
        backend="own of learn.lerobot",
        file=Path(lerobot_acting.__file__ or ""),
        base=base,
        command=("{python}", Path(lerobot_acting.__file__ or "").name),
        files=(),
        environment=f"venv:{ENVIRONMENT}",
        lock=LOCK,
        server=True,
        limits=_LIMITS,
    )


def _close(running: Running, folder: Path) -> None:
    running.end()
    shutil.rmtree(folder, ignore_errors=True)
