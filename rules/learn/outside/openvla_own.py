"""learn.openvla in OpenVLA's own environment, on a GPU."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options

from .trained import Trained

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Folder

    from .openvla_options import OpenvlaOptions

BACKEND = Backend(
    summary="OpenVLA's finetune.py in an environment of its own, on a GPU",
    profiles=("cpu", "gpu"),
    command=("{python}", "programs/openvla_training.py"),
    files=("programs/openvla_launch.py",),
    environment="venv:.envs/openvla",
    lock="envs/openvla.lock",
    gpu_gb=27.0,
    timeout_s=2_592_000.0,
    disk_gb=256.0,
    licence="MIT (code); that of the base model for the weights",
)


def train(ctx: Context, data: Folder, common: OpenvlaOptions, options: Options) -> Trained:
    """Train adapters; a training that is interrupted begins anew, as `finetune.py` cannot go on."""
    return ctx.outside("train", Trained, data=data, common=common, keep=str(ctx.keep))
