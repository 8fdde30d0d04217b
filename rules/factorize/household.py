"""Mass of a body from things of a household of about its size and shape.

Every thing of the table predicts the mass by its own mass per volume of its smallest box, with a weight that falls with
the difference of the sides, of the shape class and of the colour, and grows with the words that its name shares with
what a vision-language model calls the body. The mass is the mixture of these predictions and of one without the table,
times the likelihood of the mass that the model estimates. The less certain the body's volume is, the wider are the
predictions by the table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from dextera_build.statistics import Z90

from .estimated import Interval, Quantiles, of_mixture
from .household_things import ROWS

UNKNOWN = 0.1
"""Probability that nothing of the table tells about a body."""
NAMED_UNKNOWN, SAME_WORD = 0.05, 30.0
"""The same of a body that is called by the last word of the name of some things, `can` or `bottle`, and the weight of
these things over that of others; chosen, as `ALIKE`, on the things `shop`."""
ALIKE = 0.3
"""Standard deviation of the logarithm of a side within which things tell about one another; it and `PACKED` are the
smallest for which 90 % of the things `shop` lie in the interval that all other things give."""
PACKED = 0.2
"""Additional standard deviation of the logarithm of the density of such a thing."""
OTHER_MATERIAL = 0.05
"""Smallest likelihood of a thing of another material than the one that is told."""
TELLING = ("box",)
"""Classes whose proposed material counts, though it is not certain: that of boxes leaves 90 % of the boxes `shop` in
their interval; that of bowls would leave 75 % of them, that of mugs 81 %."""
NAMED = 30.0
"""Likelihood of a thing whose name has all of its words in what a model calls the body, over that of one with none."""
COLOURS = ("black", "blue", "brown", "gray", "green", "orange", "pink", "purple", "red", "teal", "white", "yellow")
"""Words of colours; parsing gives every body one of them."""
OWN_COLOUR = 0.9
"""Probability that a thing whose colours are known has one of them in a photograph; an assumption."""
CLASSES: dict[str, dict[str, float]] = {
    "box": {"box": 1.0, "object": 0.3, "laptop": 0.3},
    "cylinder": {"cylinder": 1.0, "object": 0.4, "mug": 0.2, "box": 0.1},
    "bottle": {"cylinder": 1.0, "object": 0.8, "box": 0.3},
    "mug": {"mug": 1.0, "bowl": 0.4, "cylinder": 0.4, "object": 0.2},
    "bowl": {"bowl": 1.0, "mug": 0.3, "object": 0.3},
    "ball": {"object": 1.0, "cylinder": 0.6, "bowl": 0.1},
    "object": {"object": 1.0, "cylinder": 0.4, "box": 0.3},
    "laptop": {"laptop": 1.0, "box": 0.5, "object": 0.2},
}
"""Kind of thing -> relative probability of each class that parsing gives it."""
LEAST = 0.02
"""The same of every other class."""


@dataclass(frozen=True)
class Thing:
    """A row of the table."""

    name: str
    kind: str
    sides_m: tuple[float, ...]
    """Three sides of the smallest box, in falling order [m]."""
    sigma: float
    """Standard deviation of their logarithms."""
    low_kg: float
    high_kg: float
    """The 5 % and the 95 % quantile of its mass [kg]."""
    material: str
    """Key of the material table; empty: none of it."""
    source: str
    colours: frozenset[str]
    """Words of the colours of such things; empty: any."""

    @property
    def word(self) -> str:
        """The last word of its name: `can`."""
        return self.name.split()[-1]


@dataclass(frozen=True)
class Mass:
    """The mass of a body, from things like it."""

    low_kg: float
    middle_kg: float
    high_kg: float
    """The 5 %, 50 % and 95 % quantile [kg]."""
    likely: tuple[str, ...]
    """The two things that are most like it, the nearest first."""
    materials: dict[str, float]
    """Key of the material table -> probability; the rest: nothing of the table tells."""


@cache
def things() -> tuple[Thing, ...]:
    """The table."""
    rows = [line.split(",") for line in ROWS.strip().splitlines()]
    return tuple(
        Thing(
            row[0],
            row[1],
            tuple(float(side) / 1000.0 for side in row[2:5]),
            float(row[5]),
            float(row[6]) / 1000.0,
            float(row[7]) / 1000.0,
            row[8],
            row[9],
            frozenset(row[10].split("|") if len(row) > 10 else ()),
        )
        for row in rows
    )


def sides(points: np.ndarray) -> np.ndarray:
    """Sides (3,) [m] of the smallest upright box about points (N, 3), in falling order."""
    import cv2

    _, flat, _ = cv2.minAreaRect(points[:, :2].astype(np.float32))
    return np.sort([*flat, float(np.ptp(points[:, 2]))])[::-1]


@dataclass(frozen=True)
class Told:
    """What is said about a body; empty or None: nothing."""

    category: str = ""
    """Its class by parsing."""
    material: str = ""
    """Key of its material."""
    confidence: float = 1.0
    """Probability of that material."""
    word: str = ""
    """What it is called by its outline, `can`; not used beside a phrase."""
    colour: str = ""
    """One of `COLOURS`."""
    phrase: str = ""
    """What a vision-language model calls it."""
    mass_kg: Interval | None = None
    """Mass that the model estimates [kg]."""


def mass_of(
    sides_m: np.ndarray,
    told: Told,
    unknown: Quantiles,
    known: Sequence[Thing] | None = None,
    volume_sigma: float = 0.0,
) -> Mass:
    """The mass of a body.

    Args:
        sides_m: (3,) sides of the smallest box about it, in falling order [m].
        told: What is said about it.
        unknown: Its mass if it is none of the things [kg].
        known: The table; None: `things()`.
        volume_sigma: Standard deviation of the log of its volume.
    """
    table = things() if known is None else known
    weights = np.array([_likeness(thing, sides_m, told) for thing in table])
    called = np.array([bool(told.word) and not told.phrase and thing.word == told.word for thing in table])
    weights, rest = np.where(called, SAME_WORD, 1.0) * weights, NAMED_UNKNOWN if called.any() else UNKNOWN
    shares = np.append(weights * (1.0 - rest) / weights.sum(), rest)
    volume = float(np.prod(sides_m))
    masses = [_mass(thing, volume, volume_sigma) for thing in table]
    low, middle, high = of_mixture(shares, [*masses, unknown], told.mass_kg)
    materials: dict[str, float] = {}
    for thing, share in zip(table, shares.tolist(), strict=False):
        if thing.material:
            materials[thing.material] = materials.get(thing.material, 0.0) + share
    return Mass(low, middle, high, tuple(table[n].name for n in np.argsort(-weights)[:2]), materials)


def _mass(thing: Thing, volume: float, volume_sigma: float) -> Quantiles:
    """The mass of such a thing whose smallest box has this volume [m^3], which is uncertain."""
    middle = math.sqrt(thing.low_kg * thing.high_kg) * volume / math.prod(thing.sides_m)
    factor = math.exp(math.hypot(math.log(thing.high_kg / thing.low_kg) / 2.0, Z90 * PACKED, Z90 * volume_sigma))
    return middle / factor, middle, middle * factor


def _likeness(thing: Thing, sides_m: np.ndarray, told: Told) -> float:
    """Density of the logarithms of the sides, times the probability of the class, material, name and colour."""
    sigma = math.hypot(thing.sigma, ALIKE)
    z = np.log(np.asarray(sides_m) / np.array(thing.sides_m)) / sigma
    shapes = CLASSES[thing.kind]
    made = _made(thing, told)
    alike = math.exp(-0.5 * float(z @ z)) / sigma**3 * made * _named(thing, told.phrase) * _coloured(thing, told.colour)
    return alike * shapes.get(told.category, LEAST) / sum(shapes.values()) + 1e-12


def _made(thing: Thing, told: Told) -> float:
    """Likelihood of the material over that of a thing that is made of it: the odds against it, at most 1."""
    if not told.material or told.material == thing.material:
        return 1.0
    if told.confidence < 1.0 and told.category not in TELLING:
        return 1.0
    return min(1.0, max(OTHER_MATERIAL, (1.0 - told.confidence) / max(told.confidence, OTHER_MATERIAL)))


def _named(thing: Thing, phrase: str) -> float:
    own = thing.name.split()
    return NAMED ** (len(set(own) & set(phrase.lower().split())) / len(own)) if phrase else 1.0


def _coloured(thing: Thing, colour: str) -> float:
    """Probability of the colour over that of a thing that may have any."""
    if not colour or not thing.colours:
        return 1.0
    own = len(thing.colours)
    chance = OWN_COLOUR / own if colour in thing.colours else (1.0 - OWN_COLOUR) / (len(COLOURS) - own)
    return len(COLOURS) * chance
