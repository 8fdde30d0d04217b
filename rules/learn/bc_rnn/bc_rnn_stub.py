"""learn.bc_rnn without training: no weights, and a falling curve."""

from __future__ import annotations

from dextera_build.learning.imitation import untrained as train
from dextera_build.rule import Backend

__all__ = ["BACKEND", "train"]

BACKEND = Backend(summary="no training: weights that no network takes", profiles=("stub",))
