"""Runs policies that other projects trained: each in the environment of its project."""

from __future__ import annotations

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.running import Predict

from .lerobot_policy import Lerobot


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """The policy of a checkpoint, in a process that ends with it."""
    return Lerobot(checkpoint)
