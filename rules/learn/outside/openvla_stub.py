"""learn.openvla without training: no adapters, and a falling curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options

from .trained import Trained, untrained

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Folder

    from .openvla_options import OpenvlaOptions

BACKEND = Backend(summary="no training: no adapters", profiles=("stub",))


def train(ctx: Context, data: Folder, common: OpenvlaOptions, options: Options) -> Trained:
    """A curve that falls."""
    return untrained(common.steps, version="0", base="0" * 64)
