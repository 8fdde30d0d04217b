"""Pictures of drawn scenes as the network sees them, with the objects of their pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from rules.factorize.measured import Workspace
from rules.factorize.regions import affinities, heights, proposals
from tests.benchmarks import bonds, household, quick_scenes
from tests.benchmarks.affinities.network import UNIT, Pictures

SEED = 29
EACH = 8
"""Scenes of each room, with one picture each."""


def scenes(seed: int, draw: Callable[[np.random.Generator], household.Piece]) -> Iterator[tuple[Workspace, np.ndarray]]:
    """Measured photographs of one room, with the object of each pixel (H, W), 0 for fixtures."""
    rng = np.random.default_rng([SEED, seed])
    room = quick_scenes.room(rng)
    for _ in range(EACH):
        if things := quick_scenes.scene(rng, room.half, draw):
            shot = quick_scenes.photograph(things, room, rng)
            seen = bonds.measured(shot, rng)
            if not seen.turns:
                yield seen, shot.labels


def pictures(seed: int, draw: Callable[[np.random.Generator], household.Piece]) -> Pictures:
    """The pictures of one room."""
    seen, labels = [], []
    for photograph, true in scenes(seed, draw):
        relief = heights.relief(photograph)
        planes = affinities.inputs(photograph, relief, proposals.colour_lab(photograph.pixels))
        size = affinities.stride(photograph.camera.fx) * affinities.COARSE
        seen.append(np.round(planes * UNIT).astype(np.int8))
        labels.append(true[size - 1 :: size, size - 1 :: size].astype(np.uint8))
    return Pictures(np.stack(seen), np.stack(labels))
