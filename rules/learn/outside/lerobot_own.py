"""learn.lerobot in LeRobot's own environment, on the CPU."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Folder

    from .lerobot_options import LerobotOptions
    from .trained import Trained

BACKEND = Backend(
    summary="LeRobot's trainer in an environment of its own, on the CPU; resumes after an interruption",
    profiles=("cpu",),
    command=("{python}", "programs/lerobot_training.py"),
    environment="venv:.envs/lerobot",
    lock="envs/lerobot.lock",
    timeout_s=2_592_000.0,
    disk_gb=256.0,
)


def train(ctx: Context, data: Folder, base: Folder | None, common: LerobotOptions, options: Options) -> Trained:
    """Train, or resume an interrupted training."""
    made: Trained = ctx.outside("train", data=data, base=base, common=common, keep=str(ctx.keep))
    return made
