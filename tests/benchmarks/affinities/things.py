"""Things to learn from: those of `household`, published meshes of `benchmark/objects_learn`, and odd ones made here.

No mesh that a table reports is among them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import transforms
from rules.reference import solids
from rules.reference.drawn.catalogue import EntryOptions, thing
from tests.benchmarks import catalogue, household, quick_scenes
from tests.benchmarks.household import Piece

KEPT = 14
"""Published meshes that nothing is learned from: choices are made on them."""
FLAT = ("box", "carton", "can", "cylinder")
"""Categories on which something can stand."""
HOLLOW = ("bowl", "pan", "tray", "basket", "mug")
"""Categories into which something can be put."""
TEXTURE_PX = 512


def published(kept: bool) -> list[str]:
    """Names of the published meshes that choices are made on, or of the others."""
    names = sorted(catalogue.entries(catalogue.LEARNED))
    order = [names[place] for place in np.random.default_rng(7).permutation(len(names))]
    return order[:KEPT] if kept else order[KEPT:]


def learned(rng: np.random.Generator) -> Piece:
    """A thing of any kind, one in seven in an orientation in which it would not rest."""
    kind = rng.uniform()
    if kind < 0.4:
        return household.draw(rng)
    found = odd(rng) if kind < 0.6 else _repainted(_published(published(False), rng), rng)
    return _turned(found, rng) if rng.uniform() < 0.15 else found


def kept(rng: np.random.Generator) -> Piece:
    """A thing that choices are made on."""
    found = _published(published(True), rng)
    return _turned(found, rng) if rng.uniform() < 0.15 else found


def reported(rng: np.random.Generator) -> Piece:
    """A thing of the tables."""
    found = _published(sorted(catalogue.entries(catalogue.REPORTED)), rng)
    return _turned(found, rng) if rng.uniform() < 0.15 else found


def _published(names: list[str], rng: np.random.Generator) -> Piece:
    whole, category = _read(names[int(rng.integers(len(names)))])
    scale = float(np.exp(rng.normal(0.0, 0.15)))
    parts = tuple(
        part.model_copy(update={"vertices": (part.vertices * scale).astype(np.float32)}) for part in whole.values()
    )
    x, y, z = (float(side) for side in np.ptp(np.concatenate([part.vertices for part in parts]), axis=0))
    inside = (0.25 * x, 0.25 * y, 0.006 * scale) if category in HOLLOW else None
    return Piece(parts, inside, z if category in FLAT else None)


@cache
def _read(name: str) -> tuple[dict[str, Mesh], str]:
    entry = EntryOptions.model_validate_json(json.dumps(catalogue.entries()[name]))
    paths = [path for part in entry.parts for path in (part.file, part.texture) if path]
    files = {path: (Path(catalogue.FOLDER) / path).read_bytes() for path in paths}
    return {key: part.mesh for key, part in thing(files, entry, TEXTURE_PX).parts.items()}, entry.category


def _repainted(found: Piece, rng: np.random.Generator) -> Piece:
    """Half of the things in other colours, where they have no texture: of one colour, or of several."""
    if rng.uniform() < 0.5:
        return found
    one = household.colour(rng)
    parts = tuple(
        part
        if part.texture is not None
        else part.model_copy(update={"colour": one if rng.uniform() < 0.6 else household.colour(rng)})
        for part in found.parts
    )
    return Piece(parts, found.inside, found.top)


def _turned(found: Piece, rng: np.random.Generator) -> Piece:
    from scipy.spatial.transform import Rotation

    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return Piece(_grounded(found.moved(transforms.rigid(turn, np.zeros(3)))))


def _grounded(parts: tuple[Mesh, ...]) -> tuple[Mesh, ...]:
    """The parts upon z = 0, about the origin."""
    corners = np.concatenate([part.vertices for part in parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    place = -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]], np.float64)
    return tuple(solids.moved(part, transforms.rigid(np.eye(3), place)) for part in parts)


def odd(rng: np.random.Generator) -> Piece:
    """A thing of several parts, on which grouping by surfaces fails."""
    kinds: tuple[tuple[float, Callable[[np.random.Generator], Piece]], ...] = (
        *((1, headphones), (1, scissors), (1, crate), (1, rack), (3, composite), (1, binoculars), (1, spray)),
        (1, lidded),
    )
    weights = np.array([weight for weight, _ in kinds])
    return kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))][1](rng)


def _alike(own: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return own if rng.uniform() < 0.6 else household.picture(rng)


def _at(x: float, y: float, z: float, turn: np.ndarray | None = None) -> np.ndarray:
    return transforms.rigid(np.eye(3) if turn is None else turn, np.array([x, y, z], np.float64))


def headphones(rng: np.random.Generator) -> Piece:
    """A band with two cups."""
    own, radius, angle = household.picture(rng), float(rng.uniform(0.06, 0.09)), np.linspace(0.0, np.pi, 20)
    path = np.c_[radius * np.cos(angle), np.zeros(20), radius * np.sin(angle)]
    parts = [solids.tube(path, float(rng.uniform(0.006, 0.015)), float(rng.uniform(0.002, 0.006)), own, 10)]
    cup, thick = float(rng.uniform(0.025, 0.042)), float(rng.uniform(0.015, 0.03))
    form = solids.turned(np.array([(0, 0), (cup, 0), (cup, thick), (0, thick)]), _alike(own, rng), 30)
    for side in (1, -1):
        turn = quick_scenes.about(1, side * np.pi / 2)
        parts.append(solids.moved(form, _at(side * (radius - 0.6 * thick), 0.0, 0.0, turn)))
    return Piece(_grounded(_laid(parts, 0.6, rng)))


def _laid(parts: list[Mesh], chance: float, rng: np.random.Generator) -> tuple[Mesh, ...]:
    if rng.uniform() < chance:
        turn = _at(0.0, 0.0, 0.0, quick_scenes.about(0, np.pi / 2))
        parts = [solids.moved(part, turn) for part in parts]
    return tuple(parts)


def scissors(rng: np.random.Generator) -> Piece:
    """Two blades that cross, with rings often of another colour."""
    own = household.picture(rng)
    other, parts = _alike(own, rng), []
    length, thick, angle = rng.uniform([0.06, 0.003, 0.05], [0.11, 0.007, 0.5]).tolist()
    round_ = np.linspace(0.0, 2.0 * np.pi, 18)
    for side in (1, -1):
        path = np.c_[np.linspace(-0.01, length, 8), np.zeros(8), np.full(8, thick * (1 + 0.3 * side))]
        blade = solids.tube(path, float(rng.uniform(0.005, 0.009)), 0.6 * thick, own, 10)
        radius = float(rng.uniform(0.014, 0.024))
        ring = np.c_[radius * np.cos(round_), np.zeros(18), 1.4 * radius * np.sin(round_)]
        lying = _at(-0.035 - radius, 0.0, thick, quick_scenes.about(0, np.pi / 2))
        grip = np.c_[np.linspace(-0.045, 0.0, 6), np.zeros(6), np.full(6, thick)]
        own_parts = (
            *(blade, solids.moved(solids.tube(ring, thick, thick, other, 8), lying)),
            solids.tube(grip, 0.006, thick, other, 8),
        )
        turn = _at(0.0, 0.0, 0.0, quick_scenes.about(2, side * angle))
        parts += [solids.moved(part, turn) for part in own_parts]
    return Piece(_grounded(tuple(parts)))


def crate(rng: np.random.Generator) -> Piece:
    """A floor and walls of slats."""
    x, y, height = rng.uniform([0.06, 0.05, 0.05], [0.16, 0.13, 0.14]).tolist()
    own, thick, count = household.picture(rng), float(rng.uniform(0.004, 0.01)), int(rng.integers(2, 5))
    parts, bar = [solids.box((2 * x, 2 * y, thick), own)], height / count * float(rng.uniform(0.4, 0.75))
    sides = ((2 * x, thick, 0.0, y), (2 * x, thick, 0.0, -y), (thick, 2 * y, x, 0.0), (thick, 2 * y, -x, 0.0))
    for number in range(count):
        for a, b, u, v in sides:
            parts.append(solids.moved(solids.box((a, b, bar), own), _at(u, v, height * (number + 0.9) / count - bar)))
    posts = [
        solids.moved(solids.box((2 * thick, 2 * thick, height), own), _at(u, v, 0)) for u in (x, -x) for v in (y, -y)
    ]
    return Piece((*parts, *posts), (x - thick, y - thick, thick))


def rack(rng: np.random.Generator) -> Piece:
    """Arches on two bars."""
    own, (x, y) = household.picture(rng), rng.uniform([0.07, 0.06], [0.16, 0.12]).tolist()
    parts, count, thick = [], int(rng.integers(4, 9)), float(rng.uniform(0.003, 0.006))
    angle = np.linspace(0.0, np.pi, 12)
    for place in np.linspace(-x, x, count):
        path = np.c_[y * np.cos(angle), np.zeros(12), float(rng.uniform(0.03, 0.1)) * np.sin(angle) + thick]
        turn = _at(float(place), 0.0, 0.0, quick_scenes.about(2, np.pi / 2))
        parts.append(solids.moved(solids.tube(path, thick, thick, own, 8), turn))
    bars = [solids.moved(solids.box((2 * x, 2 * thick, 2 * thick), own), _at(0.0, v, 0.0)) for v in (y, -y)]
    return Piece((*parts, *bars))


def composite(rng: np.random.Generator) -> Piece:
    """Two to five simple bodies that hang together."""
    own, size, at = household.picture(rng), float(rng.uniform(0.03, 0.08)), np.zeros(3)
    parts: list[Mesh] = []
    for _ in range(int(rng.integers(2, 6))):
        body = _body(size * float(rng.uniform(0.4, 1.2)), _alike(own, rng), rng)
        angle = float(rng.choice([0.0, np.pi / 2, rng.uniform(0.0, 2.0 * np.pi)]))
        turn = quick_scenes.about(int(rng.integers(3)), angle) if parts else np.eye(3)
        parts.append(solids.moved(body, transforms.rigid(turn, at)))
        corners = parts[-1].vertices
        at = 0.9 * corners[int(rng.integers(len(corners)))] + 0.1 * corners.mean(axis=0)
    return Piece(_grounded(tuple(parts)))


def _body(size: float, own: np.ndarray, rng: np.random.Generator) -> Mesh:
    kind, half = int(rng.integers(4)), 0.5 * size
    if kind == 0:
        x, y, z = (size * rng.uniform(0.4, 1.5, 3)).tolist()
        return solids.box((x, y, z), own)
    if kind == 1:
        height, upper = size * float(rng.uniform(0.5, 2.0)), half * float(rng.uniform(0.5, 1.0))
        return solids.turned(np.array([(0, 0), (half, 0), (upper, height), (0, height)]), own, 30)
    if kind == 2:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 12)[1:-1]
        middle = zip(half * np.cos(angle), half * np.sin(angle), strict=True)
        return solids.turned(np.array([(0, -half), *middle, (0, half)]), own, 30)
    path = np.c_[np.linspace(-size, size, 8), np.zeros(8), np.zeros(8)]
    return solids.tube(path, size * float(rng.uniform(0.1, 0.3)), size * float(rng.uniform(0.1, 0.3)), own, 12)


def binoculars(rng: np.random.Generator) -> Piece:
    """Two tubes with a bridge."""
    own, length = household.picture(rng), float(rng.uniform(0.09, 0.16))
    wide, thin = rng.uniform([0.02, 0.013], [0.032, 0.022]).tolist()
    apart = wide * float(rng.uniform(1.05, 1.4))
    profile = [
        (0, 0),
        (wide, 0),
        (wide, 0.35),
        (thin, 0.5),
        (thin, 0.85),
        (1.15 * thin, 0.85),
        (1.15 * thin, 1),
        (0, 1),
    ]
    tube = solids.turned(np.array(profile) * [1.0, length], own, 30)
    parts = [solids.moved(tube, _at(side * apart, 0.0, 0.0)) for side in (1, -1)]
    bridge = solids.box((2 * apart, 0.012, 0.4 * length), _alike(own, rng))
    return Piece(_grounded(_laid([*parts, solids.moved(bridge, _at(0.0, 0.0, 0.3 * length))], 0.7, rng)))


def spray(rng: np.random.Generator) -> Piece:
    """A bottle with a pistol on it."""
    body, own = household.bottle(rng), household.picture(rng)
    top = float(max(part.vertices[:, 2].max() for part in body.parts))
    head = solids.moved(solids.box((0.06, 0.02, 0.025), own), _at(0.012, 0.0, top - 0.005))
    path = np.c_[np.linspace(0.03, 0.04, 6), np.zeros(6), np.linspace(top, top - 0.05, 6)]
    return Piece((*body.parts, head, solids.tube(path, 0.005, 0.004, own, 8)))


def lidded(rng: np.random.Generator) -> Piece:
    """A vessel with a lid and its knob."""
    body = household.pan(rng) if rng.uniform() < 0.5 else household.bowl(rng)
    radius, top = float(np.abs(body.parts[0].vertices[:, 0]).max()), float(body.parts[0].vertices[:, 2].max())
    knob = [(0.012, 0.02), (0.01, 0.03), (0.018, 0.035), (0.015, 0.05), (0.0, 0.05)]
    profile = np.array([(0.0, 0.0), (1.02 * radius, 0.0), (0.9 * radius, 0.01), *knob])
    profile[:, 1] += top
    return Piece((*body.parts, solids.turned(profile, household.picture(rng), 36)))
