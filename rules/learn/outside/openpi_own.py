"""learn.openpi in openpi's own environment, on a GPU."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options

from .trained import Trained

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Folder

    from .openpi_options import OpenpiOptions

BACKEND = Backend(
    summary="openpi's train.py in an environment of its own, on a GPU; resumes after an interruption",
    profiles=("cpu", "gpu"),
    command=("{python}", "programs/openpi_training.py"),
    files=("programs/openpi_launch.py",),
    environment="venv:.envs/openpi",
    lock="envs/openpi.lock",
    gpu_gb=22.5,
    timeout_s=2_592_000.0,
    disk_gb=256.0,
    licence="Apache-2.0 (code); that of the base model for the weights",
)


def train(ctx: Context, data: Folder, camera: str, joints: int, common: OpenpiOptions, options: Options) -> Trained:
    """Train, or resume an interrupted training."""
    return ctx.outside("train", Trained, data=data, camera=camera, joints=joints, common=common, keep=str(ctx.keep))
