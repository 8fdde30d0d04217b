"""Joints from two captures against those of generated objects of eight kinds.

`python -m tests.benchmarks.joints --objects 6` prints one row per kind: joints that were found, how many of those are
wrong (another type, or more than five times the bounds off) and how many were refused, medians and worst errors, how
many are inside the intervals that they are told with (three standard deviations), and how many are within the bounds.
Objects, places, cameras and noise are drawn by seed; between both captures every joint moves by at least 15 degrees or
3 cm, and somebody shifts the object by up to 2 cm and 9 degrees. The camera is within 46 degrees of the front. Of every
part that moves, each capture measures at least a third of what the other one shows; other pairs are drawn again, and
their number is told. The shape that is cut is the true one, so that the joints alone are judged.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.objects.object import Body, Joint
from dextera_build.artifacts.objects.view import State
from dextera_build.errors import RuleError
from dextera_build.geometry import solids, transforms
from dextera_build.statistics import wilson
from dextera_build.testing import RuleRunner
from tests import factories, object_views

from . import sight
from .kinds import KINDS, Thing

APART = {"revolute": np.radians(15.0), "prismatic": 0.03}
"""Least change of a joint between both captures."""
SHARED = 1.0 / 3.0
"""Least part of a moving link's surface seen in either capture that the other one measures."""
REDRAWN: Counter[str] = Counter()
"""Kind -> pairs of captures that showed less."""
AXIS_DEG, PIVOT_MM = 2.0, 3.0
"""Bounds of a joint that counts as found."""


@dataclass(frozen=True)
class Found:
    """One true joint and what was found of it."""

    type_right: bool
    axis_deg: float
    pivot_mm: float  # 0 of a slide, which has no place
    inside: bool  # whether the 90 % intervals hold the truth

    @property
    def good(self) -> bool:
        """Whether it is within the bounds."""
        return self.type_right and self.axis_deg <= AXIS_DEG and self.pivot_mm <= PIVOT_MM

    @property
    def near(self) -> bool:
        """Whether it is right, if not within the bounds: within five times of them."""
        return self.type_right and self.axis_deg <= 5 * AXIS_DEG and self.pivot_mm <= 5 * PIVOT_MM

    def cost(self) -> tuple[bool, float]:
        """Order of nearness to the truth."""
        return not self.type_right, self.axis_deg / AXIS_DEG + self.pivot_mm / PIVOT_MM


def case(kind: str, seed: int) -> tuple[Thing, dict[str, Artifact]]:
    """The thing, and the inputs of factorize.articulate for two captures of it."""
    draw = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    thing = KINDS[kind](draw)
    while True:
        first, second = pair(thing, draw)
        place = sight.stand(first, draw, draw.uniform(-0.8, 0.8), np.radians(60.0 if thing.flat else 40.0))
        shift = shifted(draw)
        after = sight.Stand(shift @ place.pose, place.eye)
        shares = sight.shared(first, second, place, after), sight.shared(second, first, after, place)
        if min(shares) >= SHARED:
            break
        REDRAWN[kind] += 1
    return first, inputs_of(first, second, place, after, seed)


def inputs_of(first: Thing, second: Thing, place: sight.Stand, after: sight.Stand, seed: int) -> dict[str, Artifact]:
    """Inputs of factorize.articulate for two captures; the shape is the true one of the first."""
    seen, again = sight.look(first, place, seed), sight.look(second, after, seed + 1000)
    assert again.measured is not None
    above = again.view.mask & (again.measured.depth.depth > 0)
    mesh = object_views.mesh(solids.union(list(first.posed().values())))
    shape = object_views.shape(mesh).model_copy(update={"pose": factories.placed(place.pose)})
    state = State(measured=again.measured, camera=again.view.camera, above=above)
    return {"shape": shape, **object_views.whole(seen), "again": state}


def shifted(draw: np.random.Generator) -> np.ndarray:
    """A small motion on the support, (4, 4)."""
    angle = draw.uniform(-0.15, 0.15)
    c, s = np.cos(angle), np.sin(angle)
    return transforms.rigid(
        np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([*draw.uniform(-0.02, 0.02, 2), 0])
    )


def pair(thing: Thing, draw: np.random.Generator) -> tuple[Thing, Thing]:
    """Two states that differ enough in every joint, and in which no link is inside another one."""
    while True:
        first, second = thing.drawn(draw), thing.drawn(draw)
        ways = zip(first.joints, second.joints, strict=True)
        if all(abs(a.position - b.position) >= APART[a.type] for a, b in ways) and not (
            first.collides() or second.collides()
        ):
            return first, second


def compared(truth: Joint, body: Body) -> Found | None:
    """The found joint that is nearest to a true one; None if there is none."""
    return min((judged(truth, joint) for joint in body.joints), key=Found.cost, default=None)


def matched(truths: tuple[Joint, ...], body: Body) -> list[Found | None]:
    """The found joint of each true one, nearest pairs first, each used once."""
    pairs = [(judged(t, f), k, n) for k, t in enumerate(truths) for n, f in enumerate(body.joints)]
    found: dict[int, Found] = {}
    taken: set[int] = set()
    for each, k, n in sorted(pairs, key=lambda pair: pair[0].cost()):
        if k not in found and n not in taken:
            found[k] = each
            taken.add(n)
    return [found.get(k) for k in range(len(truths))]


def judged(truth: Joint, joint: Joint) -> Found:
    """A found joint against a true one."""
    axis, origin = np.array(truth.axis), np.array(truth.origin)
    mine, place = np.array(joint.axis), np.array(joint.origin)
    angle = float(np.degrees(np.arccos(min(1.0, abs(axis @ mine)))))
    # Distance of the lines where the found one is best known: in the middle of the part.
    off = 0.0 if joint.type == "prismatic" else 1000 * float(np.linalg.norm(np.cross(place - origin, axis)))
    wide = 3.0 * np.degrees(joint.axis_sigma_rad or 0.0) + 0.5
    inside = angle <= wide and off <= 3.0 * 1000 * (joint.origin_sigma_m or 0.0) + 1.0
    return Found(joint.type == truth.type, angle, off, inside)


def rows(kind: str, objects: int, start: int) -> Iterator[tuple[list[Found | None], str]]:
    """Per object, what was found of its joints, and why nothing was."""
    with tempfile.TemporaryDirectory() as scratch:
        runner = RuleRunner(scratch)
        for seed in range(start, start + objects):
            thing, inputs = case(kind, seed)
            try:
                body = runner.run("factorize.articulate", backend="screw", **inputs)
            except RuleError as error:
                yield [None] * len(thing.joints), f"seed {seed}: {error.message}"
                continue
            yield matched(thing.joints, body), ""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--objects", type=int, default=6, help="objects of each kind")
    parser.add_argument("--start", type=int, default=100, help="seed of the first one")
    parser.add_argument("--kinds", default=",".join(KINDS))
    given = parser.parse_args()
    print("| kind | joints | found | wrong | refused | axis [deg] | pivot [mm] | inside | within 2 deg, 3 mm |")
    print("|---|---|---|---|---|---|---|---|---|")
    everything: list[Found | None] = []
    for kind in given.kinds.split(","):
        mine: list[Found | None] = []
        for found, why in rows(kind, given.objects, given.start):
            mine += found
            if why:
                print(f"{kind}: {why}", file=sys.stderr, flush=True)
        everything += mine
        print(_row(kind, mine), flush=True)
    print(_row("all", everything))
    print(f"pairs drawn again because too little was seen twice: {dict(REDRAWN)}", file=sys.stderr)


def _row(kind: str, mine: list[Found | None]) -> str:
    told = [each for each in mine if each is not None]
    good, wrong = sum(each.good for each in told), sum(not each.near for each in told)
    low, high = wilson(good, len(mine))
    axis = _spread([f.axis_deg for f in told], ".2f")
    pivot = _spread([f.pivot_mm for f in told if f.type_right and f.pivot_mm > 0], ".1f")
    interval = f"{100 * good / len(mine):.0f} % [{100 * low:.0f}, {100 * high:.0f}]"
    inside, refused = sum(each.inside for each in told), len(mine) - len(told)
    cells = (kind.replace("_", " "), len(mine), len(told), wrong, refused, axis, pivot, inside, f"{good}: {interval}")
    return f"| {' | '.join(map(str, cells))} |"


def _spread(values: list[float], form: str) -> str:
    """Median and worst."""
    return f"{np.median(values):{form}} / {max(values):{form}}" if values else "-"


if __name__ == "__main__":
    main()
