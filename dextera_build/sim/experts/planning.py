"""Plan a scripted operator for a task: candidates from geometry, sorted by the arm's comfort, then rehearsed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.sim.control.operator import Command, State
from dextera_build.sim.experts.articulate import Articulate
from dextera_build.sim.experts.articulate import Push as Swing
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.grasps import candidates
from dextera_build.sim.experts.lift import Grasp, Lift
from dextera_build.sim.experts.place import Place
from dextera_build.sim.experts.push import Push, Stroke
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate, Planned, Rehearsed, rehearse, taking_turns
from dextera_build.sim.experts.room import Room
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment

Progress = Callable[[int, int, str], None]


class Practised:
    """The operator that did best in rehearsal and is free of collisions.

    Args:
        rehearsed: Candidates, best first.
        room: The task's collision checker.
    """

    def __init__(self, rehearsed: list[Rehearsed], room: Room) -> None:
        self.rehearsed = rehearsed
        self._room = room
        self._now = rehearsed[0].candidate.operator

    def begin(self, state: State) -> None:
        """Choose the first free path from `state`; if none is free, the best one reports the reason."""
        for one in self.rehearsed:
            if self._room.comfort(one.candidate.operator.legs(state), state) is not None:
                self._now = one.candidate.operator
                break
        else:
            self._now = self.rehearsed[0].candidate.operator
        self._now.begin(state)

    def command(self, state: State) -> Command | None:
        """The next command of that path."""
        return self._now.command(state)


def practise(driver: Driver, progress: Progress = lambda done, total, what: None) -> Practised:
    """Find the scripted operator of the driver's task, with the nearest limb that can reach, or the one it names.

    Args:
        driver: Its environment is used and left in an arbitrary state.
        progress: Receives the progress of the rehearsal.

    Raises:
        RuleError: The robot's hand or the task yields no candidates, or none succeeded.
    """
    environment = driver.environment
    task = environment.task
    environment.begin(starts.photographed(environment.bundle, environment.model))
    found: list[Candidate] = []
    expert = EXPERTS.get(task.primitive)
    if expert is None:
        raise RuleError(
            f"there is no scripted operator of primitive `{task.primitive}`",
            code="DXB-B253",
            facts={"operators": listing(EXPERTS)},
            hint="demonstrate the task by other means",
        )
    for limb in _limbs(environment):
        _check_hand(environment.bundle.robot, limb, expert.against)
        reach = Reach(environment.bundle.robot, limb)
        room = Room(environment, reach)
        found = expert.plan(environment, reach, room, driver.state())
        if found:
            break
    if not found:
        raise RuleError(
            f"`{task.object}` is out of reach: no way to take hold of it that the arm can go",
            code="DXB-B250",
            hint="move the base, see `align.base`",
        )
    rehearsed = rehearse(driver, found, progress)
    if not rehearsed:
        raise RuleError(
            f"no rehearsal of `{task.name}` succeeded",
            code="DXB-B251",
            facts={"candidates": len(found), "first": found[0].name},
            hint="look at the task's pictures: is the object free, and is the goal possible?",
        )
    return Practised(rehearsed, room)


def _limbs(environment: Environment) -> list[str]:
    """The limbs that may do the task, the one whose palm is nearest to its object first."""
    robot = environment.bundle.robot
    named = environment.task.limbs or robot.limb_names
    thing = environment.object_poses()[list(environment.bundle.objects).index(environment.task.object), :3]
    palms = dict(zip(robot.limb_names, environment.palm_poses()[:, :3], strict=True))
    return sorted(named, key=lambda name: float(np.linalg.norm(palms[name] - thing)))


def _lifts(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Grasps of the task's object to lift it."""
    return _grasps(environment, reach, room, state, lambda grasp: Lift(environment, reach, grasp))


def _places(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Grasps of the task's object to carry it to its target."""
    return _grasps(environment, reach, room, state, lambda grasp: Place(environment, reach, grasp))


def _grasps(
    environment: Environment, reach: Reach, room: Room, state: State, made: Callable[[Grasp], Planned]
) -> list[Candidate]:
    """Collision-free grasps of the task's object from the photographed start, most comfortable first."""
    points = environment.bundle.objects[environment.task.object].points.astype(np.float64)
    found = []
    for grasp in candidates(points, reach.grips, reach.fingers):
        found.append(Candidate(grasp.name, grasp.way, made(grasp)))
    return _comfortable(found, room, state)


def _comfortable(found: Iterable[Candidate], room: Room, state: State) -> list[Candidate]:
    """The candidates with a free path, most comfortable first, the kinds taking turns."""
    rated = [(room.comfort(each.operator.legs(state), state), each) for each in found]
    free = [(comfort, each) for comfort, each in rated if comfort is not None]
    comfortable = [each for _, each in sorted(free, key=lambda one: -one[0])]
    return taking_turns(comfortable, [each.way for each in comfortable])


def _slides(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Pushes of the task's object along its support, most comfortable first."""
    turns = (0.0, 0.4, -0.4, 0.8, -0.8, np.pi / 2, -np.pi / 2, np.pi)
    ways = [Stroke(lean, turn) for turn in turns for lean in (0.0, -0.4, 0.4)]
    return _comfortable([_pushed(way, Push(environment, reach, way)) for way in ways], room, state)


def _swings(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Pushes of the task's joint, simplest first."""
    ways = [Swing(lean, turn) for turn in (0.0, 0.3, -0.3, 0.6, -0.6) for lean in (0.0, -0.4, 0.4)]
    return [_pushed(way, Articulate(environment, reach, way)) for way in ways]


def _pushed(way: Stroke | Swing, operator: Planned) -> Candidate:
    lean, turn = np.degrees(way.lean_rad), np.degrees(way.turn_rad)
    return Candidate(f"push, fingers leaning {lean:.0f} deg, turned {turn:.0f} deg", f"push {turn:.0f}", operator)


@dataclass(frozen=True)
class Expert:
    """A scripted operator of a primitive."""

    against: str
    """The grip that it needs, see `Grip.against`."""
    plan: Callable[[Environment, Reach, Room, State], list[Candidate]]
    """Candidates of one limb from the photographed start, likeliest first."""


EXPERTS: Mapping[str, Expert] = {
    "lift": Expert("thumb", _lifts),
    "articulate": Expert("nothing", _swings),
    "push": Expert("nothing", _slides),
    "pick_and_place": Expert("thumb", _places),
}
"""Primitive -> its scripted operator."""


def _check_hand(robot: RobotModel, limb: str, against: str) -> None:
    own = robot.limbs[limb]
    missing = ["palm"] * (not own.palm) + ["tip_thumb"] * (own.thumb is None)
    grips = {name: grip.against for name, grip in own.grips.items()}
    if missing or against not in grips.values():
        what = f"frame `{missing[0]}`" if missing else f"grip against `{against}`"
        raise RuleError(
            f"the robot has no {what}" if len(robot.limbs) == 1 else f"limb `{limb}` has no {what}",
            code="DXB-B252",
            facts={"frames": listing(sorted(robot.frames), most=20), "grips": listing(sorted(grips), most=20)},
            hint="add it to `frames`, `grips` or `limbs` of the robot's recipe",
        )
