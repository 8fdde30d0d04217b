"""learn.lerobot without training: a policy without weights, and a falling curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.rule import Backend, Context, Options

from .lerobot import LerobotTrained

if TYPE_CHECKING:
    from .lerobot_options import LerobotOptions

BACKEND = Backend(summary="no training: a policy without weights", profiles=("stub",))


def train(ctx: Context, data: Folder, base: Folder | None, common: LerobotOptions, options: Options) -> LerobotTrained:
    """A curve that falls."""
    steps = np.array([1, max(2, common.steps)], np.int64)
    return LerobotTrained(Folder(files={"config.json": b"{}"}), steps, np.array([1.0, 0.5], np.float32), "0", "")
