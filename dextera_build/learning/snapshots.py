"""Snapshots of a training: weights before its end, of which trials tell when it began to succeed."""

from __future__ import annotations

import os
from pathlib import Path

from dextera_build.rule import Context


class Snapshots:
    """Weights after every so many steps, in memory and, for a training that is resumed, on disk.

    Args:
        ctx: The context of the call.
        of: Digest of the data and options of the training.
        every: Steps between two; 0: none.
    """

    def __init__(self, ctx: Context, of: str, every: int) -> None:
        self._ctx, self._of, self._every = ctx, of, every
        self._kept: dict[int, bytes] = {}

    def due(self, step: int, steps: int) -> bool:
        """Whether one is taken after `step` of so many steps; the end of the training is none."""
        return self._every > 0 and step % self._every == 0 and step < steps

    def add(self, step: int, weights: bytes) -> None:
        """Keep the weights after a step."""
        self._kept[step] = weights
        file = self._file(step)
        fresh = file.with_suffix(".new")
        try:
            fresh.write_bytes(weights)
            os.replace(fresh, file)
        except OSError as error:  # a full disk must not abort the training
            self._ctx.log(f"a snapshot could not be kept: {error.strerror or error}")

    def read(self, step: int) -> bool:
        """Read those of an interrupted training up to a step; returns whether none is missing."""
        due = range(self._every, step + 1, self._every) if self._every else range(0)
        files = {each: self._file(each) for each in due}
        if not all(file.is_file() for file in files.values()):
            return False
        self._kept = {each: file.read_bytes() for each, file in files.items()}
        return True

    def found(self, steps: int) -> dict[str, bytes]:
        """Step -> weights, without the end of the training after so many steps."""
        return {str(step): weights for step, weights in sorted(self._kept.items()) if step < steps}

    def _file(self, step: int) -> Path:
        return self._ctx.keep / f"{self._of[:16]}-{step}.safetensors"
