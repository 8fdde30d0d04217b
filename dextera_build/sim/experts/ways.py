"""Candidates of scripted operators by primitive: generated from geometry, sorted by the arm's comfort."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.articulate import Articulate
from dextera_build.sim.experts.articulate import Push as Swing
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.grasps import candidates
from dextera_build.sim.experts.handover import Handover, held_at, meetings
from dextera_build.sim.experts.lift import Lift
from dextera_build.sim.experts.place import Place, PlaceTogether
from dextera_build.sim.experts.push import Push, Stroke
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate, Planned, taking_turns
from dextera_build.sim.experts.reorient import Reorient
from dextera_build.sim.experts.room import Room
from dextera_build.sim.experts.squeeze import LiftTogether, Squeeze, in_object, squeezes
from dextera_build.sim.runtime.environment import Environment

T = TypeVar("T")
ENOUGH = 24
"""Number of free paths among which the most comfortable are selected."""
LOOKED, FEW = 800, 12
"""Number of candidates after which this smaller number of free paths suffices."""
SOME = 12
"""Number of the giver's grasps that are combined with those of the receiver."""
SHARE, MEETINGS = 8, 60
"""One in so many of the receiver's grasps is tried at each of so many meeting places."""
PAIRS = 20
"""Maximum number of pairs of grasps that are rehearsed."""
TURNS = (0.0, 0.4, -0.4, 0.8, -0.8, np.pi / 2, -np.pi / 2, np.pi, np.pi - 0.6, np.pi + 0.6)
"""Rotations of a pushing hand about the vertical, from palm first to back first [rad]."""
PITCHES = (0.0, 0.5, -0.5, 1.0, -1.0)
"""Rotations of a pushing hand about the direction of the push [rad]."""
SHARES = (0.95, 0.8)
"""Distances from the axis at which a link is pushed, see `Mechanism.pushed_at`."""
LEANS = (0.0, -0.4, 0.4, -0.8, 0.8, -1.2)
"""Tilts of pushing fingers from straight down [rad]."""
ABOVE_M = (0.16, 0.07)
"""Heights of the approach above the start of a push [m]."""
NEAR_M = 0.025
"""Distance behind a link at which a push begins if there is no space for more, as between two links [m]."""
HANDS_APART_M = 0.10
"""Minimum distance of two palms at one object [m]."""


@dataclass(frozen=True)
class Search:
    """Context of a search for candidates."""

    environment: Environment
    """The task; only its data are used."""
    reach: Reach
    """Kinematics of the limbs."""
    room: Room
    """The task's collision checker."""
    state: State
    """Poses of the robot and the objects."""
    enough: int = ENOUGH
    """Number of free paths at which the search ends."""


def _lifts(search: Search) -> list[Candidate]:
    """Grasps of the task's object to lift it."""
    return _grasps(search, lambda grasp: Lift(search.environment, search.reach, grasp))


def _places(search: Search) -> list[Candidate]:
    """Grasps of the task's object to carry it to its target."""
    return _grasps(search, lambda grasp: Place(search.environment, search.reach, grasp))


def _reorients(search: Search) -> list[Candidate]:
    """Grasps of the task's object to hold it at its target pose."""
    return _grasps(search, lambda grasp: Reorient(search.environment, search.reach, grasp))


def _grasps(search: Search, made: Callable[[Grasp], Planned]) -> list[Candidate]:
    """Collision-free grasps of the task's object, most comfortable first."""
    found = (Candidate(each.name, each.way, made(each)) for each in _grips(search.environment, search.reach))
    return _comfortable(search, found)


def _grips(environment: Environment, reach: Reach) -> list[Grasp]:
    points = environment.bundle.objects[environment.task.object].points.astype(np.float64)
    return _mixed(list(candidates(points, reach.grips, reach.fingers)), lambda grasp: grasp.way)


def _mixed(items: list[T], way: Callable[[T], str] = lambda item: "") -> list[T]:
    """A fixed shuffle that interleaves the kinds of candidates."""
    drawn = [items[number] for number in np.random.default_rng(0).permutation(len(items))]
    return taking_turns(drawn, [way(each) for each in drawn])


def _comfortable(search: Search, found: Iterable[Candidate]) -> list[Candidate]:
    """The first candidates with a free path, most comfortable first, with the kinds interleaved."""
    free: list[tuple[float, Candidate]] = []
    for number, each in enumerate(found):
        comfort = each.operator.comfort(search.room, search.state)
        free += [(comfort, each)] if comfort is not None else []
        if len(free) >= (search.enough if number < LOOKED else min(FEW, search.enough)):
            break
    comfortable = [each for _, each in sorted(free, key=lambda one: -one[0])]
    return taking_turns(comfortable, [each.way for each in comfortable])


def _lifts_together(search: Search) -> list[Candidate]:
    """Two-handed grasps on opposite sides of the task's object to lift it."""
    return _together(search, lambda way: LiftTogether(search.environment, search.reach, way))


def _places_together(search: Search) -> list[Candidate]:
    """Two-handed grasps to carry the task's object."""
    return _together(search, lambda way: PlaceTogether(search.environment, search.reach, way))


def _together(search: Search, made: Callable[[Squeeze], Planned]) -> list[Candidate]:
    name, state = search.environment.task.object, search.state
    points = search.environment.bundle.objects[name].points.astype(np.float64)
    palms = {limb: palm for limb, (palm, _) in search.reach.hands(state).items()}
    ways = _mixed(list(squeezes(points, search.reach, in_object(state.objects[name], palms))), lambda each: each.way)
    return _comfortable(search, (Candidate(each.name, each.way, made(each)) for each in ways))


def _handovers(search: Search) -> list[Candidate]:
    """Pairs of grasps with meeting poses, most comfortable first."""
    environment, reach, room, state = search.environment, search.reach, search.room, search.state
    name = environment.task.object
    giver, receiver = (reach.one(limb) for limb in reach.limbs)
    own = Room(environment, giver)
    grips = _grips(environment, giver)
    free = (each for each in grips if _given(own, giver, each, name, state) is not None)
    gives = list(itertools.islice(free, SOME))
    takes = _grips(environment, receiver)
    palms = [palm for palm, _ in reach.hands(state).values()]
    up = environment.bundle.base_pose.inverse().matrix[:3, 2]
    found: list[tuple[float, Candidate]] = []
    tried = _mixed(list(itertools.product(gives, list(meetings(state.objects[name], palms, up)))))
    for number, (given, meeting) in enumerate(tried[:MEETINGS]):
        there = held_at(giver, state, given, name, meeting)
        if there is None:
            continue
        apart = [each for each in takes if _far_apart(given, each)]
        for received in apart[number % SHARE :: SHARE]:
            operator = Handover(environment, reach, meeting, given, received)
            comfort = operator.received_comfort(room, there)
            if comfort is not None and room.comfort(operator.phases(state), state) is not None:
                way = f"{given.way} to {received.way}"
                found.append((comfort, Candidate(f"{given.name}, then {received.name}", way, operator)))
                break
        if len(found) >= min(PAIRS, search.enough):
            break
    ordered = [each for _, each in sorted(found, key=lambda one: -one[0])]
    return taking_turns(ordered, [each.way for each in ordered])


def _given(room: Room, giver: Reach, grasp: Grasp, name: str, state: State) -> float | None:
    up = room.up
    return room.comfort([{giver.limb: grasp.taking(name, state.objects[name], up)}], state)


def _far_apart(given: Grasp, received: Grasp) -> bool:
    """Whether two hands in these grasps are far enough apart."""
    return float(np.linalg.norm(given.palm[:3, 3] - received.palm[:3, 3])) > HANDS_APART_M


def _slides(search: Search) -> list[Candidate]:
    """Pushes of the task's object along its support, most comfortable first."""
    ways = [
        Stroke(lean, turn, pitch, above_m=above)
        for pitch, turn, lean, above in itertools.product(PITCHES, TURNS, LEANS, ABOVE_M)
    ]
    found = (_pushed(way, Push(search.environment, search.reach, way)) for way in _mixed(ways))
    return _comfortable(search, found)


def _swings(search: Search) -> list[Candidate]:
    """Pushes of the task's joint, most comfortable first."""
    ways = [
        Swing(lean, turn, pitch, share=share, above_m=above)
        for pitch, turn, lean, share, above in itertools.product(PITCHES, TURNS, LEANS, SHARES, ABOVE_M)
    ]
    far, near = _mixed(ways), _mixed([replace(way, clear_m=NEAR_M) for way in ways])
    half = LOOKED // 2
    found = (
        _pushed(way, Articulate(search.environment, search.reach, way)) for way in [*far[:half], *near, *far[half:]]
    )
    return _comfortable(search, found)


def _pushed(way: Stroke | Swing, operator: Planned) -> Candidate:
    lean, turn, pitch = np.degrees([way.lean_rad, way.turn_rad, way.pitch_rad])
    name = f"push, fingers leaning {lean:.0f} deg, turned {turn:.0f} deg, pitched {pitch:.0f} deg"
    name += f", from {1000 * way.above_m:.0f} mm above, {1000 * way.clear_m:.0f} mm behind"
    name += f" at {way.share:.0%}" if isinstance(way, Swing) else ""
    return Candidate(name, f"push {turn:.0f} {pitch:.0f}", operator)


@dataclass(frozen=True)
class Expert:
    """A scripted operator of a primitive."""

    primitive: str
    """The primitive."""
    against: str
    """The required grip, see `Grip.against`."""
    plan: Callable[[Search], list[Candidate]]
    """Candidates of its limbs, likeliest first."""
    hands: int = 1
    """Number of limbs."""


EXPERTS: Sequence[Expert] = (
    Expert("lift", "thumb", _lifts),
    Expert("lift", "nothing", _lifts_together, hands=2),
    Expert("articulate", "nothing", _swings),
    Expert("push", "nothing", _slides),
    Expert("pick_and_reorient", "thumb", _reorients),
    Expert("pick_and_place", "thumb", _places),
    Expert("pick_and_place", "nothing", _places_together, hands=2),
    Expert("handover", "thumb", _handovers, hands=2),
)
"""Scripted operators, likeliest first."""
