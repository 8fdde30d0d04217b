"""learn.act without training: no weights, and a falling curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.rule import Backend, Context, Options

from .trained import Trained

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations

    from .act_options import ActOptions

BACKEND = Backend(summary="no training: weights that no network takes", profiles=("stub",))

NOTHING = (2).to_bytes(8, "little") + b"{}"
"""A safetensors file without tensors."""


def train(ctx: Context, data: Demonstrations, common: ActOptions, options: Options) -> Trained:
    """Return a result without training."""
    steps = np.array([1, max(2, common.steps)], np.int64)
    curve = np.array([1.0, 0.5], np.float32)
    return Trained(NOTHING, steps, curve, (steps[:0], curve[:0]), 0.0)
