"""Sampling of batches: shuffled, and balanced over two domains.

Shuffling 300 simulated and 30 recorded trajectories together would draw ten of one per one of the other. Here every
batch contains equally many of each.
"""

from __future__ import annotations

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


class Balanced:
    """Batches with equally many samples of two domains.

    An epoch is one pass over the smaller domain, each sample once; the larger domain continues from the previous
    epoch.

    Args:
        first: Number of samples of the first domain.
        second: Number of samples of the second domain.
        batch: Samples per batch, an even number.
        seed: Seed of the order.

    Raises:
        RuleError: `batch` is odd, or half of it exceeds a domain.
    """

    def __init__(self, first: int, second: int, batch: int, seed: int) -> None:
        if batch % 2:
            raise RuleError(
                f"a batch of {batch} cannot hold as many samples of one domain as of the other",
                code="DXB-B507",
                hint=f"use {batch + 1}",
            )
        self.half = batch // 2
        if self.half > min(first, second):
            raise RuleError(
                f"half a batch is {self.half}, but a domain has {min(first, second)} samples",
                code="DXB-B508",
                facts={"first domain": first, "second domain": second},
                hint=f"use batches of {2 * min(first, second)} or smaller",
            )
        self.epoch = -(-min(first, second) // self.half)
        """Batches per epoch."""
        self._decks = Deck(first, seed, 0), Deck(second, seed, 1)

    def draw(self) -> tuple[np.ndarray, np.ndarray]:
        """The next batch: samples of the first domain and samples of the second, int64 (batch / 2,) each."""
        first, second = self._decks
        return first.draw(self.half), second.draw(self.half)


def _remaining(fresh: np.ndarray, late: np.ndarray, taken: int) -> np.ndarray:
    """The rest of a new round, in its order, after its first `taken` samples that are not `late`."""
    free = np.flatnonzero(~late)
    rest = np.ones(len(fresh), bool)
    rest[free[:taken]] = False
    return fresh[rest]
