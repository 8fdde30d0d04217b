"""Masses of things from all other things of the household table: `python -m tests.benchmarks.masses`.

Every object of the YCB set is left out of the table once; its published mass is compared with the interval that the
others give for its published size, its shape class, its colour and, where parsing has a word for such things, for this
word.
The constants were chosen on the things `shop` alone.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator

import numpy as np

from dextera_build.statistics import Z90, wilson
from rules.factorize import household
from rules.factorize.elements import naming, nouns

PUBLISHED_G = {
    "chips can": 205,
    "coffee can": 414,
    "cracker box": 411,
    "sugar box": 514,
    "soup can": 349,
    "mustard bottle": 603,
    "tuna can": 171,
    "pudding box": 187,
    "gelatin box": 97,
    "potted meat can": 370,
    "banana": 66,
    "strawberry": 18,
    "apple": 68,
    "lemon": 29,
    "peach": 33,
    "pear": 49,
    "orange": 47,
    "plum": 25,
    "pitcher": 178,
    "bleach bottle": 1131,
    "glass cleaner bottle": 1022,
    "metal bowl": 147,
    "metal mug": 118,
    "sponge": 6.2,
    "skillet": 950,
    "dinner plate": 279,
    "fork": 34,
    "spoon": 30,
    "table knife": 31,
    "spatula": 51.5,
    "cordless drill": 895,
    "wood block": 729,
    "scissors": 82,
    "padlock": 304,
    "large marker": 15.8,
    "adjustable wrench": 252,
    "screwdriver": 97,
    "hammer": 665,
    "small clamp": 19.2,
    "medium clamp": 59,
    "large clamp": 125,
    "mini soccer ball": 123,
    "softball": 191,
    "baseball": 148,
    "tennis ball": 58,
    "racquetball": 41,
    "golf ball": 46,
    "foam brick": 28,
    "die": 5.2,
    "puzzle cube": 94,
}
"""Masses published with the YCB object set [g]."""
SEEN = (
    ("red", "chips can", "cracker box", "soup can", "gelatin box", "strawberry", "apple", "plum", "foam brick", "die"),
    ("blue", "coffee can", "tuna can", "potted meat can", "pitcher", "racquetball", "glass cleaner bottle"),
    ("yellow", "sugar box", "mustard bottle", "banana", "lemon", "softball", "sponge"),
    ("orange", "peach", "orange", "cordless drill", "scissors", "hammer"),
    ("green", "pear", "tennis ball"),
    ("white", "bleach bottle", "dinner plate", "golf ball", "baseball", "mini soccer ball"),
    ("brown", "wood block", "pudding box"),
    ("gray", "metal bowl", "fork", "spoon", "table knife", "adjustable wrench", "padlock", "skillet"),
    ("black", "large marker", "spatula", "small clamp", "medium clamp", "large clamp", "screwdriver"),
)
"""The colour that most of each object shows, as far as one was written down, and the objects."""


def main() -> None:
    """Print the table and its summaries."""
    print("| thing | published [g] | estimate [g] | interval [g] | |\n| --- | --- | --- | --- | --- |")
    plain, named = [], []
    for thing in household.things():
        if thing.name not in PUBLISHED_G:
            continue
        grams = PUBLISHED_G[thing.name]
        plain.append((grams / 1000, _by_others(thing, "")))
        named.append((grams / 1000, _by_others(thing, thing.name)))
        found = plain[-1][1]
        within = found.low_kg <= grams / 1000 <= found.high_kg
        ends = f"{1000 * found.low_kg:.0f} to {1000 * found.high_kg:.0f}"
        print(f"| {thing.name} | {grams:g} | {1000 * found.middle_kg:.0f} | {ends} | {'' if within else 'outside'} |")
    print(f"\n{_summary(plain)}\nwith the name of the thing: {_summary(named)}")
    carton = household.mass_of(
        np.array([0.20, 0.14, 0.05]), household.Told("box", *_material("box")), (0.035, 0.67, 1.6)
    )
    print(f"a carton of 20 x 14 x 5 cm: {1000 * carton.low_kg:.0f} to {1000 * carton.high_kg:.0f} g\n")
    print("\n".join(_cartons()))


def _by_others(thing: household.Thing, phrase: str) -> household.Mass:
    """The mass of a thing from all others, with its word by its outline or what a model would call it."""
    others = [other for other in household.things() if other.name != thing.name]
    shapes = household.CLASSES[thing.kind]
    plain = 500.0 * float(np.prod(thing.sides_m))
    word = thing.word if thing.word in nouns.OUTLINES else ""
    colour = next((own for own, *names in SEEN if thing.name in names), "")
    shape = max(shapes, key=lambda name: shapes[name])
    told = household.Told(shape, *_material(shape), word, colour, phrase)
    return household.mass_of(np.array(thing.sides_m), told, (plain / 5, plain, plain * 5), others)


def _material(shape: str) -> tuple[str, float]:
    """The material that parsing proposes of a shape class, and its largest confidence."""
    if shape in naming.MATERIALS:
        return naming.MATERIALS[shape], naming.SURE
    return "plastic", naming.UNSURE


def _cartons() -> Iterator[str]:
    """How narrow intervals of boxes are, each from all other things of the table."""
    boxes = [thing for thing in household.things() if thing.kind == "box"]
    cartons = [thing for thing in boxes if thing.material == "cardboard"]
    yield "| things | interval by | in the 90 % interval | factor of its ends |\n| --- | --- | --- | --- |"
    for name, rows in (("boxes", boxes), ("cartons", cartons)):
        for by, material in (("size", ("", 1.0)), ("size and material", _material("box"))):
            inside, factors = [], []
            for thing in rows:
                others = [other for other in household.things() if other.name != thing.name]
                full = 480.0 * float(np.prod(thing.sides_m))  # as `physics` has without the table
                unknown = (full / 10, full, 3.5 * full)
                found = household.mass_of(np.array(thing.sides_m), household.Told("box", *material), unknown, others)
                inside.append(_within(thing, found.low_kg, found.high_kg))
                factors.append(found.high_kg / found.low_kg)
            yield f"| {len(rows)} {name} | {by} | {np.mean(inside):.2f} | {statistics.median(factors):.1f} |"
        for by, width in (("density", 1e3), ("density of things of this size", household.ALIKE)):
            logs = _off(rows, width)
            narrow = _narrowest(logs)
            held = max(float(((logs >= end) & (logs <= end + math.log(4.0))).mean()) for end in logs)
            yield f"| {len(rows)} {name} | {by}, narrowest | 0.90 | {narrow:.1f} |"
            yield f"| {len(rows)} {name} | {by}, a factor of 4 | {held:.2f} | 4.0 |"


def _within(thing: household.Thing, low: float, high: float) -> float:
    """Part of a thing's own masses that an interval [kg] holds; 0 or 1 if its mass is published."""
    if thing.name in PUBLISHED_G:
        return float(low <= PUBLISHED_G[thing.name] / 1000.0 <= high)
    middle, sigma = math.sqrt(thing.low_kg * thing.high_kg), math.log(thing.high_kg / thing.low_kg) / (2.0 * Z90)
    own = statistics.NormalDist(math.log(middle), sigma)
    return own.cdf(math.log(high)) - own.cdf(math.log(low))


def _off(rows: list[household.Thing], width: float) -> np.ndarray:
    """Logarithms of masses over those by the mean log density of the others of `rows`, weighted by likeness of size."""
    logs = np.log([thing.sides_m for thing in rows])
    density = np.array([math.log(thing.low_kg * thing.high_kg) / 2.0 for thing in rows]) - logs.sum(axis=1)
    likeness = np.exp(-0.5 * ((logs[:, None] - logs) ** 2).sum(axis=-1) / width**2) + 1e-9
    np.fill_diagonal(likeness, 0.0)
    expected = likeness @ density / likeness.sum(axis=1)
    own = statistics.NormalDist()
    steps = np.array([own.inv_cdf(chance) for chance in np.linspace(0.025, 0.975, 20)])
    found = []
    for thing, middle, other in zip(rows, density, expected, strict=True):
        if thing.name in PUBLISHED_G:
            known = math.log(PUBLISHED_G[thing.name] / 1000.0) - math.log(math.prod(thing.sides_m))
            found.append(np.full(len(steps), known - other))
        else:
            found.append(middle - other + steps * math.log(thing.high_kg / thing.low_kg) / (2.0 * Z90))
    return np.concatenate(found)


def _narrowest(logs: np.ndarray) -> float:
    """Smallest factor between the ends of an interval that holds 90 % of logarithms."""
    ordered = np.sort(logs)
    held = math.ceil(0.9 * len(ordered))
    return math.exp(float((ordered[held - 1 :] - ordered[: len(ordered) - held + 1]).min()))


def _summary(results: list[tuple[float, household.Mass]]) -> str:
    held = sum(found.low_kg <= truth <= found.high_kg for truth, found in results)
    low, high = wilson(held, len(results))
    factor = statistics.median(found.high_kg / found.low_kg for _, found in results)
    error = statistics.median(abs(math.log(found.middle_kg / truth)) for truth, found in results)
    return (
        f"{held} of {len(results)} in the 90 % interval ({100 * low:.0f} to {100 * high:.0f} %); median factor of its "
        f"ends {factor:.1f}; median error a factor of {math.exp(error):.2f}"
    )


if __name__ == "__main__":
    main()
