"""learn.act without training: no weights, and a falling curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.learning.imitation import untrained
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations
    from dextera_build.learning.trained import Trained

    from .act_options import ActOptions

BACKEND = Backend(summary="no training: weights that no network takes", profiles=("stub",))


def train(ctx: Context, data: Demonstrations, common: ActOptions, options: Options) -> Trained:
    """Return a result without training."""
    return untrained(common.steps)
