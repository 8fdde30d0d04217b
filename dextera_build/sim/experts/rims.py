"""Two-handed grasps of a vessel: each hand pinches the rim on its own side, and both raise it.

Fingertips that press on the outside of a wide vessel need arms that reach around it; hands that come from above need
less room beside it.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.sim.experts.candidates import Search
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.grasps import candidates
from dextera_build.sim.experts.motion import Leg, shifted
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.reachable import Reachable
from dextera_build.sim.experts.rehearse import Candidate, Planned, taking_turns
from dextera_build.sim.experts.squeeze import in_object

LIKELY, SOME = 160, 24
"""Numbers of the likeliest grasps of a hand that are checked, and of free ones among them that suffice."""
TRIED, ALIKE, PAIRS = 80, 3, 12
"""Numbers of pairs that are checked, of free pairs of a kind, and of free pairs that suffice."""
OFF_AXIS_M = 0.05
"""Maximum distance of the middle between both hands from the object's axis [m]."""


@dataclass(frozen=True)
class Rims:
    """Grasps of two hands; the same for every start."""

    grasps: Mapping[str, Grasp]
    """Limb -> its grasp."""
    name: str
    """Human-readable description."""
    way: str
    """Kind of grasp."""

    def lifting(self, name: str, base: np.ndarray, up: np.ndarray, rise_m: float) -> dict[str, list[Leg]]:
        """The approach of both hands, their grasps, and the lift.

        Args:
            name: Body of the object.
            base: T_base_object (4, 4).
            up: (3,) vertical in the base.
            rise_m: Height of the lift [m].
        """
        return {
            limb: [
                *grasp.taking(name, base, up),
                Leg(shifted(base @ grasp.palm, up * rise_m), grasp.closed, grasp.seconds[4], "lift", name, True),
            ]
            for limb, grasp in self.grasps.items()
        }


def by_rims(search: Search, made: Callable[[Rims], Planned]) -> list[Candidate]:
    """Collision-free grasps of the rim of the task's object with two hands, most comfortable first; none without a rim.

    Args:
        search: Context of the search; its reach has two limbs.
        made: The operator with a pair of grasps.
    """
    points = search.environment.bundle.objects[search.environment.task.object].points.astype(np.float64)
    axis = (points.min(axis=0) + points.max(axis=0))[:2] / 2
    given = [_given(search, limb, points) for limb in search.reach.limbs]
    found: list[tuple[float, Candidate]] = []
    used: Counter[str] = Counter()
    for pair in itertools.islice(_pairs(given, axis), TRIED):
        one, other = pair
        way = f"{one.way} and {other.way}"
        if used[way] >= ALIKE:
            continue
        name = f"both hands by the rim: {one.name}; {other.name}"
        operator = made(Rims(dict(zip(search.reach.limbs, pair, strict=True)), name, way))
        comfort = operator.comfort(search.room, search.state)
        if comfort is not None:
            used[way] += 1
            found.append((comfort, Candidate(name, way, operator)))
        if len(found) >= min(PAIRS, search.enough):
            break
    ordered = [each for _, each in sorted(found, key=lambda each: -each[0])]
    return taking_turns(ordered, [each.way for each in ordered])


def _given(search: Search, limb: str, points: np.ndarray) -> list[tuple[float, Grasp]]:
    """Free grasps of the rim by a hand on its side, with their distances from reachable poses [m], nearest first."""
    environment, state, reach = search.environment, search.state, search.reach.one(limb)
    name = environment.task.object
    base = state.objects[name]
    grips = {label: grip for label, grip in reach.grips.items() if grip.against == "thumb"}
    palms = in_object(base, {one: palm for one, (palm, _) in search.reach.hands(state).items()})
    side = palms[limb] - np.mean(list(palms.values()), axis=0)
    rims = [each for each in candidates(points, grips, reach.fingers) if each.wall is not None and each.wall @ side > 0]
    if not rims:
        return []
    away = Reachable(reach.arm).away_m(base @ np.array([each.palm for each in rims]))
    nearest = [(float(away[number]), rims[number]) for number in np.argsort(away, kind="stable")]
    # In turn around the rim, because the nearest ones may all be in front of the object.
    likely = taking_turns(nearest, [grasp.way for _, grasp in nearest])[:LIKELY]
    room = CollisionCheck(environment, reach)
    free = (each for each in likely if _free(room, reach, each[1], name, search))
    return list(itertools.islice(free, SOME))


def _free(room: CollisionCheck, reach: Reach, grasp: Grasp, name: str, search: Search) -> bool:
    legs = grasp.taking(name, search.state.objects[name], room.up)
    return room.comfort([{reach.limb: legs}], search.state) is not None


def _pairs(given: Sequence[list[tuple[float, Grasp]]], axis: np.ndarray) -> Iterator[tuple[Grasp, Grasp]]:
    """Pairs of grasps between which the object's axis (2,) is, likeliest first."""
    ranked: list[tuple[float, int, Grasp, Grasp]] = []
    for (far, one), (wide, other) in itertools.product(*given):
        assert one.wall is not None
        assert other.wall is not None
        middle = float(np.linalg.norm((one.wall + other.wall)[:2] / 2 - axis))
        if middle < OFF_AXIS_M:
            ranked.append((far + wide + middle, len(ranked), one, other))
    for *_, one, other in sorted(ranked, key=lambda each: each[:2]):
        yield one, other
