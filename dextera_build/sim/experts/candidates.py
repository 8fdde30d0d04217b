"""Shared code of scripts of primitives: candidates from geometry, and their order by the arm's comfort."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.grasps import candidates
from dextera_build.sim.experts.pushing import Stroke
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate, Planned, taking_turns
from dextera_build.sim.experts.squeeze import Squeeze, in_object, squeezes
from dextera_build.sim.primitives import folders
from dextera_build.sim.runtime.environment import Environment

T = TypeVar("T")
ENOUGH = 24
"""Number of free paths among which the most comfortable are selected."""
LOOKED, FEW = 800, 12
"""Number of candidates after which this smaller number of free paths suffices."""
TURNS = (0.0, 0.4, -0.4, 0.8, -0.8, np.pi / 2, -np.pi / 2, np.pi, np.pi - 0.6, np.pi + 0.6)
"""Rotations of a pushing hand about the vertical, from palm first to back first [rad]."""
PITCHES = (0.0, 0.5, -0.5, 1.0, -1.0)
"""Rotations of a pushing hand about the direction of the push [rad]."""
LEANS = (0.0, -0.4, 0.4, -0.8, 0.8, -1.2)
"""Tilts of pushing fingers from straight down [rad]."""
ABOVE_M = (0.16, 0.07)
"""Heights of the approach above the start of a push [m]."""


@dataclass(frozen=True)
class Search:
    """Context of a search for candidates."""

    environment: Environment
    """The task; only its data are used."""
    reach: Reach
    """Kinematics of the limbs."""
    room: CollisionCheck
    """The task's collision checker."""
    state: State
    """Poses of the robot and the objects."""
    enough: int = ENOUGH
    """Number of free paths at which the search ends."""


@dataclass(frozen=True)
class Expert:
    """A scripted operator of a primitive."""

    against: str
    """The required grip, see `Grip.against`."""
    plan: Callable[[Search], list[Candidate]]
    """Candidates of its limbs, likeliest first."""
    hands: int = 1
    """Number of limbs."""


def experts(primitive: str) -> Sequence[Expert]:
    """The scripted operators of a primitive, likeliest first: `EXPERTS` of its `script.py`.

    Raises:
        RuleError: There is none, or it is not in the key of the call that runs.
    """
    found: Sequence[Expert] = folders.module(primitive, "script").EXPERTS
    return found


def grasps(search: Search, made: Callable[[Grasp], Planned]) -> list[Candidate]:
    """Collision-free grasps of the task's object, most comfortable first."""
    found = (Candidate(each.name, each.way, made(each)) for each in grips(search.environment, search.reach))
    return comfortable(search, found)


def grips(environment: Environment, reach: Reach) -> list[Grasp]:
    """Grasps of the task's object, in a fixed shuffle."""
    points = environment.bundle.objects[environment.task.object].points.astype(np.float64)
    return mixed(list(candidates(points, reach.grips, reach.fingers)), lambda grasp: grasp.way)


def mixed(items: list[T], way: Callable[[T], str] = lambda item: "") -> list[T]:
    """A fixed shuffle that interleaves the kinds of candidates."""
    drawn = [items[number] for number in np.random.default_rng(0).permutation(len(items))]
    return taking_turns(drawn, [way(each) for each in drawn])


def comfortable(search: Search, found: Iterable[Candidate]) -> list[Candidate]:
    """The first candidates with a free path, most comfortable first, with the kinds interleaved."""
    free: list[tuple[float, Candidate]] = []
    for number, each in enumerate(found):
        comfort = each.operator.comfort(search.room, search.state)
        free += [(comfort, each)] if comfort is not None else []
        if len(free) >= (search.enough if number < LOOKED else min(FEW, search.enough)):
            break
    comfortable = [each for _, each in sorted(free, key=lambda one: -one[0])]
    return taking_turns(comfortable, [each.way for each in comfortable])


def together(search: Search, made: Callable[[Squeeze], Planned]) -> list[Candidate]:
    """Collision-free grasps with two hands on opposite sides of the task's object, most comfortable first."""
    name, state = search.environment.task.object, search.state
    points = search.environment.bundle.objects[name].points.astype(np.float64)
    palms = {limb: palm for limb, (palm, _) in search.reach.hands(state).items()}
    ways = mixed(list(squeezes(points, search.reach, in_object(state.objects[name], palms))), lambda each: each.way)
    return comfortable(search, (Candidate(each.name, each.way, made(each)) for each in ways))


def pushing(way: Stroke, operator: Planned, more: str = "") -> Candidate:
    """The candidate of a push; `more` completes its name."""
    lean, turn, pitch = np.degrees([way.lean_rad, way.turn_rad, way.pitch_rad])
    name = f"push, fingers leaning {lean:.0f} deg, turned {turn:.0f} deg, pitched {pitch:.0f} deg"
    name += f", from {1000 * way.above_m:.0f} mm above, {1000 * way.clear_m:.0f} mm behind{more}"
    return Candidate(name, f"push {turn:.0f} {pitch:.0f}", operator)
