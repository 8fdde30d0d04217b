"""Sampling of batches: shuffled, and with a fixed number of samples of every part of a mixture.

Shuffling 300 simulated and 30 recorded trajectories together would draw ten of one per one of the other. Here a mixture
of 1 : 1 has equally many of each in every batch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.errors import RuleError


class Deck:
    """Draws samples endlessly: each once per round, none twice within one draw.

    Args:
        count: Number of samples.
        seed: Seed of the order, any non-negative integers.
    """

    def __init__(self, count: int, *seed: int) -> None:
        self.count = count
        self._seed = seed
        self._round = 0
        self._rest = self._shuffled()

    def draw(self, size: int) -> np.ndarray:
        """The next `size` samples, int64 (size,).

        Raises:
            RuleError: There are fewer than `size` samples.
        """
        if size > self.count:
            raise RuleError(
                f"a draw of {size} cannot be made from {self.count} samples without repeating one",
                code="DXB-B506",
                hint=f"use batches of {self.count} or smaller",
            )
        drawn, self._rest = self._rest[:size], self._rest[size:]
        missing = size - len(drawn)
        if missing:
            fresh = self._shuffled()
            # Samples at the end of the old round come later in the new one, so no draw contains a sample twice.
            late = np.isin(fresh, drawn)
            fresh = np.concatenate([fresh[~late][:missing], _remaining(fresh, late, missing)])
            drawn, self._rest = np.concatenate([drawn, fresh[:missing]]), fresh[missing:]
        return drawn

    def _shuffled(self) -> np.ndarray:
        order = np.random.default_rng([*self._seed, self._round]).permutation(self.count)
        self._round += 1
        return order


class Mixed:
    """Batches with a fixed number of samples of every part of a mixture.

    An epoch is one pass over the part that is used up first, each of its samples once; the others continue from the
    previous epoch.

    Args:
        sizes: Number of samples of each part.
        weights: Relative number of samples of each part in a batch.
        batch: Samples per batch, a multiple of the sum of the weights.
        seed: Seed of the order.

    Raises:
        RuleError: `batch` is no such multiple, or a part has fewer samples than a batch needs of it.
    """

    def __init__(self, sizes: Sequence[int], weights: Sequence[int], batch: int, seed: int) -> None:
        whole, shares = sum(weights), " : ".join(map(str, weights))
        if batch % whole:
            raise RuleError(
                f"a batch of {batch} cannot be divided {shares} between the parts of a mixture",
                code="DXB-B507",
                hint=f"use {batch + whole - batch % whole}",
            )
        self.counts = tuple(batch * weight // whole for weight in weights)
        """Samples of each part in a batch."""
        for size, count in zip(sizes, self.counts, strict=True):
            if count > size:
                most = min(size // weight for size, weight in zip(sizes, weights, strict=True)) * whole
                raise RuleError(
                    f"a batch needs {count} samples of a part of the mixture that has {size}",
                    code="DXB-B508",
                    facts={"parts": ", ".join(map(str, sizes)), "weights": shares},
                    hint=f"use batches of {most} or smaller",
                )
        self.epoch = min(-(-size // count) for size, count in zip(sizes, self.counts, strict=True))
        """Batches per epoch."""
        # 0 and 1 are the seeds of initial weights and of the split.
        self._decks = [Deck(size, seed, 2 + number) for number, size in enumerate(sizes)]

    def draw(self) -> list[np.ndarray]:
        """The next batch: the samples of each part, int64."""
        return [deck.draw(count) for deck, count in zip(self._decks, self.counts, strict=True)]


def _remaining(fresh: np.ndarray, late: np.ndarray, taken: int) -> np.ndarray:
    """The rest of a new round, in its order, after its first `taken` samples that are not `late`."""
    free = np.flatnonzero(~late)
    rest = np.ones(len(fresh), bool)
    rest[free[:taken]] = False
    return fresh[rest]
