"""Household things from parameters, for the scenes that the bonds learn from: no mesh of any table is among them."""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import transforms
from rules.reference import solids, textures

Colour = tuple[float, float, float]
SIDES = 40
"""Facets of a circle."""


@dataclass(frozen=True)
class Piece:
    """One thing, upright on z = 0 about the origin [m]."""

    parts: tuple[Mesh, ...]
    inside: tuple[float, float, float] | None = None
    """Half widths of what fits into it along x and y, and the height of its floor [m]; None if it is closed."""
    top: float | None = None
    """Height of a level top on which something stands [m]; None without one."""
    word: str = ""
    """What it is called: the name of its family, or of the mesh's kind."""

    def moved(self, pose: np.ndarray) -> tuple[Mesh, ...]:
        """Its parts after a rigid (4, 4) motion."""
        return tuple(solids.moved(part, pose) for part in self.parts)


def draw(rng: np.random.Generator) -> Piece:
    """A thing of a random family, of random size and colours."""
    families: tuple[tuple[float, Callable[[np.random.Generator], Piece]], ...] = (
        *((4, carton), (3, can), (3, bottle), (3, bowl), (3, mug), (2, plate), (2, tray), (2, pan)),
        *((2, book), (1.5, fruit), (2, tool), (1, stepped)),
    )
    weights = np.array([weight for weight, _ in families])
    return _called(families[int(rng.choice(len(families), p=weights / weights.sum()))][1], rng)


def small(rng: np.random.Generator) -> Piece:
    """A thing that fits into a vessel."""
    return _called((fruit, can, carton, tool)[int(rng.choice(4, p=[0.5, 0.2, 0.15, 0.15]))], rng)


def _called(family: Callable[[np.random.Generator], Piece], rng: np.random.Generator) -> Piece:
    return replace(family(rng), word=family.__name__)


def colour(rng: np.random.Generator) -> Colour:
    """Any colour; one in four is white, grey or black."""
    saturation = 0.05 * rng.uniform() if rng.uniform() < 0.25 else rng.uniform(0.15, 1.0)
    return colorsys.hsv_to_rgb(float(rng.uniform()), float(saturation), float(rng.uniform(0.08, 0.98)))


def picture(rng: np.random.Generator, own: Colour | None = None) -> np.ndarray:
    """A surface: one colour, specks, wood or broad bands."""
    own = colour(rng) if own is None else own
    seed, kind = int(rng.integers(2**31)), rng.uniform()
    if kind < 0.55:
        return textures.plain(128, 128, own, 0.03, 5, seed)
    if kind < 0.7:
        return textures.speckled(128, 128, own, colour(rng), float(rng.uniform(0.1, 0.5)), seed)
    if kind < 0.8:
        return textures.wood(128, 128, own, int(rng.integers(1, 4)), seed)
    return _printed(own, rng)


def _printed(own: Colour, rng: np.random.Generator) -> np.ndarray:
    """A label: bands, and boxes of other colours."""
    found = textures.plain(128, 128, own, 0.03, 5, int(rng.integers(2**31)))
    if rng.uniform() < 0.6:
        low = float(rng.uniform(0.05, 0.6))
        found = textures.banded(found, ((low, float(rng.uniform(low + 0.1, 1.0)), colour(rng)),))
    for _ in range(int(rng.integers(1, 7))):
        y, x = rng.integers(0, 110, 2)
        h, w = rng.integers(8, 70, 2)
        found[y : y + h, x : x + w] = np.round(255 * np.array(colour(rng)))
    return found


def carton(rng: np.random.Generator) -> Piece:
    """A box whose faces are printed alike or apart."""
    size = np.sort(rng.uniform([0.02, 0.04, 0.06], [0.09, 0.16, 0.26]))
    size = size[rng.permutation(3)]
    faces = [picture(rng)] * 6 if rng.uniform() < 0.3 else [_printed(colour(rng), rng) for _ in range(6)]
    if rng.uniform() < 0.4:
        base = colour(rng)
        faces = [_printed(base, rng) for _ in range(6)]
    atlas = np.concatenate([np.concatenate(faces[:3], axis=1), np.concatenate(faces[3:], axis=1)])
    mesh = solids.box((float(size[0]), float(size[1]), float(size[2])), atlas, atlas=True)
    return Piece((mesh,), top=float(size[2]))


def can(rng: np.random.Generator) -> Piece:
    """A cylinder with a label, its lid often of metal."""
    radius, height = float(rng.uniform(0.02, 0.055)), float(rng.uniform(0.03, 0.16))
    rim = 0.003 if rng.uniform() < 0.6 else 0.0
    body = _turned([(0, 0), (radius, 0), (radius, height), (radius - 0.004, height), (0, height - rim)], rng)
    lid = _turned([(0, height - 0.004), (radius - 0.002, height - 0.004), (radius - 0.002, height - rim + 0.0005),
                   (0, height - rim + 0.0005)], rng, _grey(rng))  # fmt: skip
    return Piece((body, lid) if rng.uniform() < 0.7 else (body,), top=height)


def bottle(rng: np.random.Generator) -> Piece:
    """A body with a shoulder, a neck and a cap."""
    radius, height = float(rng.uniform(0.022, 0.05)), float(rng.uniform(0.12, 0.28))
    neck, shoulder = radius * float(rng.uniform(0.25, 0.7)), float(rng.uniform(0.5, 0.8)) * height
    neck_at = shoulder + float(rng.uniform(0.2, 0.8)) * (height - shoulder)
    profile = [(0, 0), (radius, 0), (radius, shoulder), (neck, neck_at), (neck, height), (0, height)]
    cap = neck * float(rng.uniform(1.02, 1.5))
    low = height - float(rng.uniform(0.01, 0.03))
    lid = _turned([(0, low), (cap, low), (cap, height + 0.003), (0, height + 0.003)], rng)
    return Piece((_turned(profile, rng), lid))


def bowl(rng: np.random.Generator) -> Piece:
    """Open upwards, thin walls; inside often of another colour."""
    return _vessel(rng, float(rng.uniform(0.05, 0.12)), float(rng.uniform(0.035, 0.09)), float(rng.uniform(0.3, 0.8)))


def plate(rng: np.random.Generator) -> Piece:
    """A flat vessel."""
    return _vessel(rng, float(rng.uniform(0.07, 0.14)), float(rng.uniform(0.012, 0.03)), float(rng.uniform(0.5, 0.8)))


def mug(rng: np.random.Generator) -> Piece:
    """A cup, three in four with a handle."""
    radius, height = float(rng.uniform(0.03, 0.05)), float(rng.uniform(0.06, 0.13))
    own = picture(rng)
    cup = _vessel(rng, radius, height, float(rng.uniform(0.7, 1.0)), own)
    if rng.uniform() < 0.25:
        return cup
    angle = np.linspace(-np.pi / 2, np.pi / 2, 14)
    reach, half = float(rng.uniform(0.02, 0.04)), 0.35 * height
    path = np.c_[radius * 0.95 + reach * np.cos(angle), np.zeros(14), height / 2 + half * np.sin(angle)]
    handle = solids.tube(path, 0.006, 0.004, own if rng.uniform() < 0.8 else picture(rng), 10)
    return Piece((*cup.parts, handle), cup.inside)


def pan(rng: np.random.Generator) -> Piece:
    """A shallow vessel with a straight handle, often of another colour."""
    radius, height = float(rng.uniform(0.07, 0.13)), float(rng.uniform(0.03, 0.07))
    own = picture(rng)
    vessel = _vessel(rng, radius, height, float(rng.uniform(0.75, 1.0)), own)
    length, rise = float(rng.uniform(0.08, 0.16)), float(rng.uniform(0.0, 0.04))
    path = np.c_[
        np.linspace(radius * 0.97, radius + length, 8), np.zeros(8), np.linspace(0.8 * height, height + rise, 8)
    ]
    handle = solids.tube(path, 0.011, 0.006, picture(rng) if rng.uniform() < 0.6 else own, 10)
    return Piece((*vessel.parts, handle), vessel.inside)


def tray(rng: np.random.Generator) -> Piece:
    """A floor and four walls."""
    x, y, h = (float(v) for v in rng.uniform([0.06, 0.05, 0.02], [0.2, 0.14, 0.1]))
    own, wall = picture(rng), 0.006
    slabs = (
        *((2 * x, 2 * y, wall, 0.0, 0.0), (2 * x, wall, h, 0.0, y), (2 * x, wall, h, 0.0, -y)),
        *((wall, 2 * y, h, x, 0.0), (wall, 2 * y, h, -x, 0.0)),
    )
    parts = tuple(
        solids.moved(solids.box((a, b, c), own), transforms.rigid(np.eye(3), np.array([u, v, 0.0])))
        for a, b, c, u, v in slabs
    )
    return Piece(parts, (x - wall, y - wall, wall))


def book(rng: np.random.Generator) -> Piece:
    """A slab: a book, a telephone, a board, a remote control."""
    x, y, z = (float(v) for v in rng.uniform([0.05, 0.08, 0.008], [0.16, 0.24, 0.05]))
    mesh = solids.slab((x, y, z), 0.006, 0.002, np.concatenate([picture(rng), picture(rng)]))
    return Piece((mesh,), top=z)


def fruit(rng: np.random.Generator) -> Piece:
    """A ball, or something longer."""
    radius, stretch = float(rng.uniform(0.018, 0.045)), float(rng.uniform(0.8, 1.5))
    angle = np.linspace(-np.pi / 2, np.pi / 2, 14)
    profile = [(radius * np.cos(a), radius * stretch * (1 + np.sin(a))) for a in angle]
    return Piece((_turned([(0, profile[0][1]), *profile[1:-1], (0, profile[-1][1])], rng),))


def tool(rng: np.random.Generator) -> Piece:
    """A handle and a shaft that lie: a spatula, a screwdriver, a brush."""
    length, thick = float(rng.uniform(0.06, 0.12)), float(rng.uniform(0.008, 0.018))
    grip = solids.tube(
        np.c_[np.linspace(-length, 0.0, 8), np.zeros(8), np.full(8, thick)], thick, thick, picture(rng), 12
    )
    width, flat = float(rng.uniform(0.004, 0.03)), float(rng.uniform(0.003, 0.008))
    shaft = np.c_[np.linspace(-0.01, length * rng.uniform(0.5, 1.5), 8), np.zeros(8), np.full(8, thick)]
    return Piece((grip, solids.tube(shaft, width, flat, picture(rng), 12)))


def stepped(rng: np.random.Generator) -> Piece:
    """Two boxes that are one thing, of one surface: a toy, a stapler, a machine."""
    low, high = rng.uniform([0.05, 0.04, 0.02], [0.16, 0.1, 0.06]), rng.uniform([0.03, 0.02, 0.03], [0.08, 0.08, 0.1])
    own = picture(rng)
    first = solids.box((float(low[0]), float(low[1]), float(low[2])), own)
    second = solids.box((float(high[0]), float(min(high[1], low[1])), float(high[2])), own)
    side = float(rng.uniform(-0.5, 0.5)) * float(low[0])
    return Piece(
        (first, solids.moved(second, transforms.rigid(np.eye(3), np.array([side, 0.0, float(low[2]) - 0.002]))))
    )


def _vessel(
    rng: np.random.Generator, radius: float, height: float, foot: float, own: np.ndarray | None = None
) -> Piece:
    """A revolved vessel with thin walls; in two of five the inside has a surface of its own."""
    own = picture(rng) if own is None else own
    wall, bulge = 0.004, float(rng.uniform(0.6, 1.6))
    rise = np.linspace(0.0, 1.0, 8)
    width = radius * (foot + (1 - foot) * rise**bulge)
    outer = np.array([(0.0, 0.0), *zip(width, height * rise, strict=True)])
    inner = np.array([*zip(width[::-1] - wall, np.maximum(height * rise[::-1], wall), strict=True), (0.0, wall)])
    if rng.uniform() < 0.4:
        lengths = [float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in (outer, inner)]
        rows = round(len(own) * lengths[1] / sum(lengths))
        own = np.concatenate([picture(rng)[:rows], own[rows:]])  # the texture's upper rows are the inside
    half = 0.65 * radius * foot
    return Piece((solids.turned(np.concatenate([outer, inner]), own, SIDES),), (half, half, wall))


def _turned(profile: list[tuple[float, float]], rng: np.random.Generator, own: Colour | None = None) -> Mesh:
    return solids.turned(np.array(profile, np.float64), picture(rng, own), SIDES)


def _grey(rng: np.random.Generator) -> Colour:
    value = float(rng.uniform(0.3, 0.9))
    return (value, value, value)
