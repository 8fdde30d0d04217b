"""Groups are divided where both whole parts speak for two objects, and left whole where they are one."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import transforms
from rules.factorize.regions import grouping, heights, patches, proposals, revision
from rules.factorize.regions.partition import Grouping
from rules.reference import solids
from tests.rules.factorize.regions.test_bonds import at, workspace
from tests.tabletops import FINE, Tabletop, box, bowl, cylinder, tabletop

Thing = list[tuple[Mesh, np.ndarray]]
WHITE = (0.85, 0.85, 0.8)


def leaning(angle_deg: float) -> np.ndarray:
    """A slab 0.14 m high that leans against the wall x = 0 of a box."""
    angle = np.radians(angle_deg)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return transforms.rigid(turn, np.array([-0.075, 0.0, 0.01]))


def mug(handle: tuple[float, float, float]) -> Thing:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 14)
    path = np.c_[0.042 + 0.03 * np.cos(angle), np.zeros(14), 0.05 + 0.035 * np.sin(angle)]
    picture = np.full((8, 8, 3), np.round(255 * np.array(handle)), np.uint8)
    return [(bowl(WHITE), at(0, 0)), (solids.tube(path, 0.007, 0.006, picture, 12), at(0, 0))]


def joined(shown: Tabletop) -> tuple[Grouping, np.ndarray]:
    """One group of all patches above the table, joined from the left; and the true label of each pixel of the crop."""
    seen = workspace(shown)
    relief = heights.relief(seen)
    crop = patches.surfaces(relief, relief.raised & relief.over, seen, proposals.colour_lab(seen.pixels))
    parts = Grouping(crop, patches.patches(crop))
    true = shown.labels.labels[crop.top :, crop.left :][: crop.height.shape[0], : crop.height.shape[1]]
    owner = {n: int(np.bincount(true.ravel()[patch.pixels]).argmax()) for n, patch in parts.groups.items()}
    for label in sorted(set(owner.values())):
        numbers = [n for n in sorted(owner) if owner[n] == label]
        kept = numbers[0]
        for number in numbers[1:]:
            kept = parts.join(kept, number)
    while len(parts.groups) > 1:
        parts.join(*sorted(parts.groups)[:2])
    return parts, true
