"""Bodies with legs, compartments or loops from parameters: a half for choosing, and one that is reported."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dextera_build.geometry import lie, solids, transforms
from dextera_build.geometry.solids import Solid

SIDES = 40
"""Facets of a circle."""


def stool(rng: np.random.Generator) -> Solid:
    """A rectangular plate on four legs, often splayed."""
    x, y, height = rng.uniform([0.1, 0.09, 0.07], [0.28, 0.2, 0.2])
    leg, plate = rng.uniform([0.01, 0.008], [0.025, 0.02])
    splay = 0.0 if rng.uniform() < 0.5 else float(rng.uniform(0.05, 0.2))
    inset = leg / 2 + float(rng.uniform(0.0, 0.015)) + splay * height * 0.3
    corners = [(sx * (x / 2 - inset), sy * (y / 2 - inset)) for sx in (-1, 1) for sy in (-1, 1)]
    legs = [_leg(np.array(at), np.array(at) + splay * height * np.sign(at), leg, height) for at in corners]
    return solids.union([solids.box((x, y, plate), (0, 0, height - plate / 2)), *legs])


def tripod(rng: np.random.Generator) -> Solid:
    """A round plate on three legs."""
    radius, height, leg = rng.uniform([0.05, 0.07, 0.01], [0.12, 0.18, 0.02])
    plate, start = float(rng.uniform(0.008, 0.018)), float(rng.uniform(0, 2))
    reach = radius - leg / 2 - 0.003
    turns = start + np.arange(3) * 2 * np.pi / 3
    places = [reach * np.array([np.cos(turn), np.sin(turn)]) for turn in turns]
    legs = [_leg(at, at * 1.1, leg, height) for at in places]
    return solids.union([_disc(radius, height - plate, height), *legs])


def bridge(rng: np.random.Generator) -> Solid:
    """A plate on two side panels: a monitor stand, a rack."""
    x, y, height = rng.uniform([0.18, 0.1, 0.07], [0.32, 0.2, 0.14])
    wall = float(rng.uniform(0.008, 0.02))
    sides = [solids.box((wall, y, height), (side * (x - wall) / 2, 0, height / 2)) for side in (-1, 1)]
    return solids.union([solids.box((x, y, wall), (0, 0, height - wall / 2)), *sides])


def table(rng: np.random.Generator) -> Solid:
    """A round plate on four legs near its rim, with a shelf half way down."""
    radius, height, leg = rng.uniform([0.08, 0.1, 0.01], [0.13, 0.18, 0.018])
    places = [(radius - leg) * np.array([np.cos(turn), np.sin(turn)]) for turn in 0.4 + np.arange(4) * np.pi / 2]
    return solids.union([_disc(radius, height - 0.012, height), *(_leg(at, at, leg, height) for at in places)])


def organiser(rng: np.random.Generator) -> Solid:
    """A thin-walled tray with unequal compartments: a divider across, and one or two in one half."""
    x, y, height = rng.uniform([0.18, 0.12, 0.04], [0.3, 0.2, 0.09])
    wall, part = rng.uniform([0.002, 0.3], [0.005, 0.6])
    body = _tray(x, y, height, wall)
    at = x * (part - 0.5)
    walls = [solids.box((wall, y, height), (at, 0, height / 2))]
    count = int(rng.integers(1, 3))
    long = x / 2 - at
    for number in range(count):
        place = y * ((number + 1) / (count + 1) - 0.5)
        walls.append(solids.box((long, wall, height), (at + long / 2, place, height / 2)))
    return solids.union([body, *walls])


def cutlery_tray(rng: np.random.Generator) -> Solid:
    """A tray with three to five equal compartments side by side."""
    x, y, height = rng.uniform([0.22, 0.18, 0.04], [0.34, 0.24, 0.06])
    wall, count = float(rng.uniform(0.0025, 0.006)), int(rng.integers(3, 6))
    places = x * (np.arange(1, count) / count - 0.5)
    walls = [solids.box((wall, y, height), (place, 0, height / 2)) for place in places]
    return solids.union([_tray(x, y, height, wall), *walls])


def ice_tray(rng: np.random.Generator) -> Solid:
    """A block with two rows of rectangular wells between thick walls."""
    count, cell = int(rng.integers(3, 6)), float(rng.uniform(0.026, 0.036))
    wall, height = float(rng.uniform(0.006, 0.012)), float(rng.uniform(0.028, 0.045))
    x, y = count * (cell + wall) + wall, 2 * (cell + wall) + wall
    body = solids.box((x, y, height), (0, 0, height / 2))
    for column in range(count):
        for row in range(2):
            at = [wall + cell / 2 + i * (cell + wall) - size / 2 for i, size in ((column, x), (row, y))]
            body = solids.difference(body, solids.box((cell, cell, height), (*at, height / 2 + 0.006)))
    return body


def toolbox(rng: np.random.Generator) -> Solid:
    """A deep tray with a divider along its middle and one across."""
    x, y, height = rng.uniform([0.2, 0.13, 0.06], [0.3, 0.18, 0.1])
    wall = float(rng.uniform(0.004, 0.008))
    walls = [
        solids.box((x, wall, height), (0, 0, height / 2)),
        solids.box((wall, y, height), (x * float(rng.uniform(-0.2, 0.2)), 0, height / 2)),
    ]
    return solids.union([_tray(x, y, height, wall), *walls])


def brick(rng: np.random.Generator) -> Solid:
    """A brick with two or three round holes through it."""
    x, y, height = rng.uniform([0.16, 0.08, 0.03], [0.24, 0.11, 0.05])
    count = int(rng.integers(2, 4))
    radius = min(x / count, y) * float(rng.uniform(0.3, 0.38))
    places = x * ((np.arange(count) + 0.5) / count - 0.5)
    holes = [_disc(radius, -0.01, height + 0.01, (place, 0.0)) for place in places]
    return solids.difference(solids.box((x, y, height), (0, 0, height / 2)), solids.union(holes))


def holder(rng: np.random.Generator) -> Solid:
    """A block with four to six round wells, for tubes or pens."""
    count, radius, height = int(rng.integers(2, 4)), *rng.uniform([0.014, 0.04], [0.022, 0.07])
    pitch = 2.7 * radius
    body = solids.box((count * pitch, 2 * pitch, height), (0, 0, height / 2))
    places = [((i - (count - 1) / 2) * pitch, (j - 0.5) * pitch) for i in range(count) for j in range(2)]
    wells = [_disc(radius, 0.3 * height, height + 0.01, place) for place in places]
    return solids.difference(body, solids.union(wells))


def shears(rng: np.random.Generator) -> Solid:
    """Scissors that lie, a little open: two blades, two finger loops."""
    length, thick = float(rng.uniform(0.14, 0.2)), float(rng.uniform(0.006, 0.011))
    width, gap = 0.08 * length, float(rng.uniform(0.04, 0.2))
    parts = []
    for side in (-1, 1):
        blade = _bar(np.zeros(2), 0.55 * length, side * gap, width, thick)
        shank = _bar(np.zeros(2), 0.28 * length, np.pi - side * (gap + 0.25), width, thick)
        end = 0.34 * length * np.array([np.cos(np.pi - side * (gap + 0.25)), np.sin(np.pi - side * (gap + 0.25))])
        parts += [blade, shank, _loop(end, 0.11 * length, 0.075 * length, thick)]
    return solids.union(parts)


def fork(rng: np.random.Generator) -> Solid:
    """A flat fork with three tines."""
    length, thick = float(rng.uniform(0.16, 0.2)), float(rng.uniform(0.003, 0.006))
    tines = [_bar(np.array([0.0, side * 0.011]), 0.3 * length, 0.0, 0.006, thick) for side in (-1, 0, 1)]
    head = solids.box((0.02, 0.03, thick), (0.0, 0, thick / 2))
    return solids.union([*tines, head, _bar(np.zeros(2), 0.6 * length, np.pi, 0.012, thick)])


def key(rng: np.random.Generator) -> Solid:
    """A large key: a ring, a shaft, a bit."""
    length, thick = float(rng.uniform(0.09, 0.14)), float(rng.uniform(0.004, 0.007))
    ring = _loop(np.array([-0.2 * length, 0.0]), 0.17 * length, 0.1 * length, thick)
    bit = solids.box((0.1 * length, 0.16 * length, thick), (0.6 * length, 0.08 * length, thick / 2))
    return solids.union([ring, _bar(np.array([-0.06 * length, 0.0]), 0.75 * length, 0.0, 0.07 * length, thick), bit])


def frame(rng: np.random.Generator) -> Solid:
    """Spectacles without temples, or a picture frame: a bar with two openings."""
    width, thick = float(rng.uniform(0.05, 0.07)), float(rng.uniform(0.005, 0.012))
    rings = [_loop(np.array([side * 0.62 * width, 0.0]), 0.55 * width, 0.45 * width, thick) for side in (-1, 1)]
    return solids.union([*rings, solids.box((0.24 * width, 0.01, thick), (0, 0, thick / 2))])


CHOSEN: dict[str, Callable[[np.random.Generator], Solid]] = {
    one.__name__: one for one in (stool, tripod, organiser, ice_tray, brick, shears, fork)
}
"""Kinds on which constants are chosen."""
REPORTED: dict[str, Callable[[np.random.Generator], Solid]] = {
    one.__name__: one for one in (bridge, table, cutlery_tray, toolbox, holder, key, frame)
}
"""Kinds that are only reported; those of `CHOSEN` are reported with other seeds."""


def _leg(top: np.ndarray, foot: np.ndarray, width: float, height: float) -> Solid:
    """A square leg (2,) to (2,) whose upper end is just below the top of the plate."""
    level = solids.box((width, width, height - 0.002), (0, 0, (height - 0.002) / 2))
    rise = level.vertices[:, 2:] / height
    corners = level.vertices + np.c_[rise * top + (1 - rise) * foot, np.zeros(len(rise))]
    return Solid(corners, level.faces)


def _disc(radius: float, low: float, high: float, at: tuple[float, float] = (0.0, 0.0)) -> Solid:
    made = solids.loft(np.stack([solids.ring(radius, radius, 2.0, z, SIDES) for z in (low, high)]))
    return Solid(made.vertices + np.array([*at, 0.0]), made.faces)


def _tray(x: float, y: float, height: float, wall: float) -> Solid:
    inner = solids.box((x - 2 * wall, y - 2 * wall, height), (0, 0, height / 2 + wall))
    return solids.difference(solids.box((x, y, height), (0, 0, height / 2)), inner)


def _bar(start: np.ndarray, length: float, turn: float, width: float, thick: float) -> Solid:
    bar = solids.box((length, width, thick), (length / 2, 0, thick / 2))
    return bar.moved(transforms.rigid(lie.about_z(turn), np.array([*start, 0.0])))


def _loop(at: np.ndarray, outer: float, inner: float, thick: float) -> Solid:
    place = (float(at[0]), float(at[1]))
    return solids.difference(_disc(outer, 0.0, thick, place), _disc(inner, -0.01, thick + 0.01, place))
