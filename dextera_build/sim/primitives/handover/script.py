"""Scripted operator of primitive `handover`: one hand brings the object in front of both, the other takes it."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from dextera_build.geometry import lie
from dextera_build.sim.control.operator import BASE, FREE, State
from dextera_build.sim.experts.candidates import Expert, Search, grips
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.motion import Leg, Plan, shifted
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.reachable import Reachable
from dextera_build.sim.experts.rehearse import Candidate, taking_turns
from dextera_build.sim.experts.scripted import Taking
from dextera_build.sim.runtime.environment import Environment

RISES_M = (0.16, 0.24)
"""Heights of the meeting place above the start [m]."""
TURNS = np.radians([0, 45, -45, 90, -90])
"""Rotations of the object about the vertical on the way to the meeting place."""
SECONDS = (0.8, 1.8, 0.8, 0.9, 0.8)
"""Durations: lift, bring, open, retreat, hold [s]."""

SOME, TAKES = 24, 1200
"""Numbers of grasps of giver and receiver that are combined."""
TRIED, ALIKE = 400, 4
"""Number of pairs of grasps that are checked, and maximum number of free ones of a kind."""
PAIRS = 20
"""Maximum number of pairs of grasps that are rehearsed."""
HANDS_APART_M = 0.10
"""Minimum distance of two palms at one object [m]."""


class Handover(Taking):
    """The giver takes the object to a meeting place, the receiver grasps it there, and the giver lets go.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of giver and receiver, in this order.
        meeting: T_base_object (4, 4) of the handover.
        given: The giver's grasp.
        received: The receiver's grasp.
    """

    def __init__(
        self, environment: Environment, reach: Reach, meeting: np.ndarray, given: Grasp, received: Grasp
    ) -> None:
        super().__init__(environment, reach)
        self._giver, self._receiver = reach.limbs
        self.meeting, self.given, self.received = meeting, given, received

    def taking(self, state: State) -> Plan:
        """The giver's grasp, and the way to the meeting place."""
        grasp, base = self.given, state.objects[self._object]
        raised = shifted(base @ grasp.palm, self._up * RISES_M[0] / 2)
        legs = grasp.taking(self._object, base, self._up)
        lift, bring, *_ = SECONDS
        met = self.meeting @ grasp.palm
        return {
            self._giver: [
                *legs,
                self._held(raised, grasp.closed, lift, "lift"),
                self._held(met, grasp.closed, bring, "bring", FREE),
            ]
        }

    def going_on(self, state: State, base: np.ndarray, last: Mapping[str, Leg], held: Mapping[str, np.ndarray]) -> Plan:
        """The receiver's grasp, and the giver's retreat; the giver corrects for the grasp actually achieved."""
        given, received = self.given, self.received
        palm = self.meeting @ held[self._giver]
        legs = received.taking(self._object, self.meeting, self._up)
        taken = legs[-1]
        back = shifted(palm, palm[:3, :3] @ given.palm[:3, :3].T @ given.away)
        _, _, opens, retreat, hold = SECONDS
        stays = [self._held(palm, given.closed, leg.seconds, leg.segment, BASE) for leg in legs]
        return {
            self._giver: [
                *stays,
                self._held(palm, given.open, opens, "release", BASE),
                self._held(back, given.open, retreat, "retreat", BASE),
                self._held(back, given.open, hold, "retreat", BASE),
            ],
            self._receiver: [*legs, *(self._held(taken.palm, received.closed, s, n) for s, n in _rest())],
        }

    def comfort(self, room: CollisionCheck, state: State) -> float | None:
        """Comfort of the less comfortable arm, over the giver's path and the receiver's approach."""
        there = held_at(self._reach.one(self._giver), state, self.given, self._object, self.meeting)
        given, taken = super().comfort(room, state), None if there is None else self.received_comfort(room, there)
        return None if given is None or taken is None else min(given, taken)

    def received_comfort(self, room: CollisionCheck, there: State) -> float | None:
        """Comfort of the receiver's approach, with the object in the giver's hand at the meeting place."""
        return room.comfort([{self._receiver: self.phases(there)[1][self._receiver][:4]}], there)


def held_at(giver: Reach, state: State, grasp: Grasp, name: str, meeting: np.ndarray) -> State | None:
    """The state in which the giver holds the object at the meeting place; None if out of reach."""
    solved = giver.arm.solve(meeting @ grasp.palm, giver.joints(state), posture=giver.arm.home)
    if not solved.reached():
        return None
    moved = state.joints.copy()
    moved[giver.places(giver.arm.joints)] = solved.joints
    return State(moved, {**state.objects, name: meeting}, state.displacement)


def _rest() -> Sequence[tuple[float, str]]:
    _, _, opens, retreat, hold = SECONDS
    return (opens, "release"), (retreat, "retreat"), (hold, "retreat")


def meetings(base: np.ndarray, palms: Sequence[np.ndarray], up: np.ndarray) -> Iterator[np.ndarray]:
    """Poses (4, 4) in the base at which an object may be handed over.

    Args:
        base: T_base_object (4, 4) at the start.
        palms: Poses (4, 4) of both palms at home.
        up: (3,) vertical in the base.
    """
    middle = np.mean([palm[:3, 3] for palm in palms], axis=0)
    way = middle - base[:3, 3]
    way -= up * (way @ up)
    for rise in RISES_M:
        for part in (1.0, 0.7):
            for turn in TURNS:
                met = shifted(base, way * part + up * rise)
                met[:3, :3] = lie.rotation(up * turn) @ base[:3, :3]
                yield met


def _handovers(search: Search) -> list[Candidate]:
    """Pairs of grasps with meeting poses that suit both arms, most comfortable first."""
    environment, reach, room, state = search.environment, search.reach, search.room, search.state
    name = environment.task.object
    giver, receiver = (reach.one(limb) for limb in reach.limbs)
    own = CollisionCheck(environment, giver)
    free = (each for each in grips(environment, giver) if _given(own, giver, each, name, state) is not None)
    gives = list(itertools.islice(free, SOME))
    takes = grips(environment, receiver)[:TAKES]
    palms = [palm for palm, _ in reach.hands(state).values()]
    up = environment.bundle.base_pose.inverse().matrix[:3, 2]
    places = list(meetings(state.objects[name], palms, up))
    found: list[tuple[float, Candidate]] = []
    used: Counter[str] = Counter()
    for meeting, given, received in itertools.islice(_pairs(giver, receiver, places, gives, takes), TRIED):
        way = f"{given.way} to {received.way}"
        there = held_at(giver, state, given, name, meeting)
        if there is None or used[way] >= ALIKE:
            continue
        operator = Handover(environment, reach, meeting, given, received)
        comfort = operator.received_comfort(room, there)
        if comfort is not None and room.comfort(operator.phases(state), state) is not None:
            used[way] += 1
            found.append((comfort, Candidate(f"{given.name}, then {received.name}", way, operator)))
        if len(found) >= min(PAIRS, search.enough):
            break
    ordered = [each for _, each in sorted(found, key=lambda one: -one[0])]
    return taking_turns(ordered, [each.way for each in ordered])


def _pairs(
    giver: Reach, receiver: Reach, places: Sequence[np.ndarray], gives: Sequence[Grasp], takes: Sequence[Grasp]
) -> Iterator[tuple[np.ndarray, Grasp, Grasp]]:
    """Meeting pose, giver's grasp and receiver's grasp, by how far both palms are from poses that the arms reach."""
    if not gives or not takes:
        return
    given, taken = (np.array([each.palm for each in grasps]) for grasps in (gives, takes))
    gaps = np.linalg.norm(given[:, None, :3, 3] - taken[None, :, :3, 3], axis=2)
    from_giver, from_receiver = Reachable(giver.arm), Reachable(receiver.arm)
    away = [from_giver.away_m(met @ given)[:, None] + from_receiver.away_m(met @ taken)[None, :] for met in places]
    total = np.where(gaps > HANDS_APART_M, np.array(away), np.inf)
    for number in np.argsort(total, axis=None, kind="stable"):
        place, one, other = np.unravel_index(number, total.shape)
        if not np.isfinite(total[place, one, other]):
            return
        yield places[place], gives[one], takes[other]


def _given(room: CollisionCheck, giver: Reach, grasp: Grasp, name: str, state: State) -> float | None:
    up = room.up
    return room.comfort([{giver.limb: grasp.taking(name, state.objects[name], up)}], state)


EXPERTS = (Expert("thumb", _handovers, hands=2),)
