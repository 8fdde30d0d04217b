"""learn.lerobot without training: a policy without weights, and a falling curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options

from .trained import Trained, untrained

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Folder

    from .lerobot_options import LerobotOptions

BACKEND = Backend(summary="no training: a policy without weights", profiles=("stub",))


def train(ctx: Context, data: Folder, base: Folder | None, common: LerobotOptions, options: Options) -> Trained:
    """A curve that falls."""
    return untrained(common.steps, version="0", instruction="")
