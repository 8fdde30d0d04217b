"""learn.lerobot in LeRobot's own environment, on a GPU."""

from __future__ import annotations

from dextera_build.rule import Backend

from .lerobot_own import train

__all__ = ["BACKEND", "train"]

BACKEND = Backend(
    summary="LeRobot's trainer in an environment of its own, on a GPU; resumes after an interruption",
    command=("{python}", "programs/lerobot_training.py"),
    environment="venv:.envs/lerobot",
    lock="envs/lerobot.lock",
    gpu_gb=8.0,
    timeout_s=2_592_000.0,
    disk_gb=256.0,
)
