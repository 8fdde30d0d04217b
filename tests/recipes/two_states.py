"""Two captures of a laptop that somebody opened further, and of a box that was moved a little."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from tests import factories, tabletops
from tests.benchmarks.joints import kinds

LAPTOP = factories.pose(-0.06, 0.02, yaw=0.35)
OPENED = (np.radians(70.0), np.radians(105.0))
"""Opening in both captures [rad]."""
BOX = (factories.pose(0.22, -0.12, yaw=0.2), factories.pose(0.235, -0.105, yaw=0.3))
EYE = factories.look_at((0.0, -0.75, 0.6), (0.0, 0.0, 0.05))


def thing() -> kinds.Thing:
    """The laptop, closed."""
    return kinds.laptop(np.random.default_rng(4))


def shown(opening: float, place: np.ndarray) -> tabletops.Tabletop:
    """The laptop, opened [rad], and the box at a place."""
    posed = thing().at({"hinge": opening}).posed()
    links = [
        (
            Mesh(vertices=s.vertices.astype(np.float32), faces=s.faces.astype(np.int32), colour=(0.2, 0.2, 0.22)),
            LAPTOP,
        )
        for s in posed.values()
    ]
    box = (tabletops.box(0.07, 0.05, 0.06, (0.75, 0.15, 0.1)), place)
    return tabletops.tabletop(*links, box, eye=EYE, lens=tabletops.FINE)


def write(folder: Path) -> None:
    """Write the captures `before` and `after`."""
    for name, opening, place in zip(("before", "after"), OPENED, BOX, strict=True):
        tabletops.write(shown(opening, place).capture, folder / name)
