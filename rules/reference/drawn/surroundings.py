"""Random table, room, furniture and lamps of a world."""

from __future__ import annotations

import colorsys

import numpy as np

from dextera_build.artifacts.scenes.world import Lamp, Part, Thing
from dextera_build.geometry import transforms

from .. import solids, textures
from ..room import RoomOptions, TableOptions, fixture

Colour = tuple[float, float, float]
FLOOR_M = -0.74
"""Height of the floor [m]."""


def table(rng: np.random.Generator) -> TableOptions:
    """A table: size, surface, colour."""
    surface = ("wood", "wood", "plain", "speckled")[int(rng.integers(4))]
    if surface == "wood":
        hue, saturation, value = rng.uniform(0.05, 0.11), rng.uniform(0.25, 0.6), rng.uniform(0.35, 0.8)
    else:
        hue, saturation, value = rng.uniform(), rng.uniform(0.0, 0.3), rng.uniform(0.3, 0.9)
    width, depth, thickness = rng.uniform([1.0, 0.7, 0.02], [1.6, 1.0, 0.05]).tolist()
    return TableOptions(
        size_m=(width, depth, thickness),
        colour=colorsys.hsv_to_rgb(float(hue), float(saturation), float(value)),
        surface=surface,  # type: ignore[arg-type]
        planks=int(rng.integers(1, 9)),
        gloss=float(rng.uniform(0.0, 0.4)),
        seed=int(rng.integers(2**31)),
    )


def fixtures(drawn: TableOptions, rng: np.random.Generator) -> dict[str, Thing]:
    """Table, floor and wall; at random a cupboard, a shelf on the wall, a large box at the table's far edge."""
    depth = drawn.size_m[1]
    room = RoomOptions(
        wall_y_m=float(depth / 2 + rng.uniform(0.02, 1.2)),
        wall=_pale(rng),
        floor=_pale(rng, 0.35, 0.65),
        seed=int(rng.integers(2**31)),
    )
    parts = drawn.parts() | room.parts()
    if rng.uniform() < 0.5:
        parts |= _cupboard(room, rng)
    if rng.uniform() < 0.5:
        parts |= _shelf(room, rng)
    if rng.uniform() < 0.2:
        parts |= _machine(drawn, rng)
    return {name: fixture(name, part) for name, part in parts.items()}


def light(rng: np.random.Generator) -> tuple[tuple[Lamp, ...], float]:
    """A lamp with shadows, one without, and the ambient intensity; together they light white to at most 1."""
    angle = rng.uniform(0, 2 * np.pi)
    key = Lamp(
        direction=(float(np.cos(angle)), float(np.sin(angle)), float(-rng.uniform(0.8, 2.0))),
        strength=float(rng.uniform(0.3, 0.45)),
        shadow=True,
    )
    fill = Lamp(direction=(float(rng.uniform(-1, 1)), 0.7, -0.7), strength=float(rng.uniform(0.08, 0.15)))
    return (key, fill), float(rng.uniform(0.3, 0.4))


def _pale(rng: np.random.Generator, low: float = 0.65, high: float = 0.95) -> Colour:
    return colorsys.hsv_to_rgb(float(rng.uniform()), float(rng.uniform(0.0, 0.15)), float(rng.uniform(low, high)))


def _cupboard(room: RoomOptions, rng: np.random.Generator) -> dict[str, Part]:
    """A closed cupboard that stands on the floor at the wall."""
    width, depth, height = rng.uniform([0.4, 0.25, 0.6], [0.9, 0.45, 1.9]).tolist()
    place = (float(rng.uniform(-0.9, 0.9)), room.wall_y_m - depth / 2 - 0.02, FLOOR_M)
    return {"cupboard": _box((width, depth, height), place, rng)}


def _shelf(room: RoomOptions, rng: np.random.Generator) -> dict[str, Part]:
    """Boards on the wall with a few boxes on them."""
    width, depth = rng.uniform([0.5, 0.15], [1.2, 0.25]).tolist()
    x, first = float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.3, 0.6))
    y = room.wall_y_m - depth / 2 - 0.005
    boards = {f"board_{i}": _box((width, depth, 0.02), (x, y, first + 0.32 * i), rng) for i in range(2)}
    spots = np.linspace(-0.4, 0.4, 4) * width
    boxes = {
        f"book_{i}": _box((0.05 + 0.08 * float(rng.uniform()), 0.12, 0.2), (x + float(spot), y, first + 0.02), rng)
        for i, spot in enumerate(spots)
    }
    return boards | boxes


def _machine(drawn: TableOptions, rng: np.random.Generator) -> dict[str, Part]:
    """A large box, such as a microwave oven, at the far edge of the table."""
    width, depth, height = rng.uniform([0.35, 0.2, 0.22], [0.5, 0.3, 0.35]).tolist()
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    place = (side * (drawn.size_m[0] - width) / 2, (drawn.size_m[1] - depth) / 2, 0.0)
    return {"machine": _box((width, depth, height), place, rng)}


def _box(size: tuple[float, float, float], place: tuple[float, float, float], rng: np.random.Generator) -> Part:
    picture = textures.plain(256, 256, _pale(rng, 0.25, 0.9), 0.03, 6, int(rng.integers(2**31)))
    mesh = solids.moved(solids.box(size, picture), transforms.rigid(np.eye(3), np.array(place)))
    return Part(mesh=mesh, gloss=0.1)
