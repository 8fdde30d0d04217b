"""Plan a scripted operator for a task: candidates from geometry, sorted by the arm's comfort, then rehearsed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.sim.control.operator import Command, State
from dextera_build.sim.experts.articulate import Articulate, Push
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.grasps import candidates
from dextera_build.sim.experts.lift import Lift
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate, Rehearsed, rehearse, taking_turns
from dextera_build.sim.experts.room import Room
from dextera_build.sim.runtime import starts

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
    """Find the scripted operator of the driver's task.

    Args:
        driver: Its environment is used and left in an arbitrary state.
        progress: Receives the progress of the rehearsal.

    Raises:
        RuleError: The robot's hand or the task yields no candidates, or none succeeded.
    """
    environment = driver.environment
    task, robot = environment.task, environment.bundle.robot
    _check_hand(robot, "thumb" if task.primitive == "lift" else "nothing")
    environment.begin(starts.photographed(environment.bundle, environment.model))
    reach, state = Reach(robot), driver.state()
    room = Room(environment, reach)
    found = _lifts(driver, reach, room, state) if task.primitive == "lift" else _pushes(driver, reach)
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


def _lifts(driver: Driver, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Collision-free grasps of the task's object from the photographed start, most comfortable first."""
    environment = driver.environment
    points = environment.bundle.objects[environment.task.object].points.astype(np.float64)
    found: list[tuple[float, Candidate]] = []
    for grasp in candidates(points, environment.bundle.robot.grips, reach.fingers):
        operator = Lift(environment, reach, grasp)
        comfort = room.comfort(operator.legs(state), state)
        if comfort is not None:
            found.append((comfort, Candidate(grasp.name, grasp.way, operator)))
    comfortable = [candidate for _, candidate in sorted(found, key=lambda one: -one[0])]
    return taking_turns(comfortable, [candidate.way for candidate in comfortable])


def _pushes(driver: Driver, reach: Reach) -> list[Candidate]:
    """Pushes of the task's joint, simplest first."""
    ways = [Push(lean, turn) for turn in (0.0, 0.3, -0.3, 0.6, -0.6) for lean in (0.0, -0.4, 0.4)]
    return [
        Candidate(
            f"push, fingers leaning {np.degrees(way.lean_rad):.0f} deg, turned {np.degrees(way.turn_rad):.0f} deg",
            f"push {np.degrees(way.turn_rad):.0f}",
            Articulate(driver.environment, reach, way),
        )
        for way in ways
    ]


def _check_hand(robot: RobotModel, against: str) -> None:
    missing = sorted({"palm", "tip_thumb"} - set(robot.frames))
    grips = {name: grip.against for name, grip in robot.grips.items()}
    if missing or against not in grips.values():
        raise RuleError(
            f"the robot has no frame `{missing[0]}`" if missing else f"the robot has no grip against `{against}`",
            code="DXB-B252",
            facts={"frames": listing(sorted(robot.frames), most=20), "grips": listing(sorted(grips), most=20)},
            hint="add it to `frames` or `grips` of the robot's recipe",
        )
