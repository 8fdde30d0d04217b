"""Plan a scripted operator for a task: candidates from geometry, sorted by the arm's comfort, then rehearsed."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.sim.control.operator import Command, OutOfReach, State
from dextera_build.sim.experts.articulate import Articulate
from dextera_build.sim.experts.articulate import Push as Swing
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.grasps import candidates
from dextera_build.sim.experts.handover import Handover, meetings
from dextera_build.sim.experts.lift import Lift
from dextera_build.sim.experts.place import Place, PlaceTogether
from dextera_build.sim.experts.push import Push, Stroke
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate, Planned, Rehearsed, drawn, rehearse, taking_turns
from dextera_build.sim.experts.reorient import Reorient
from dextera_build.sim.experts.room import Room
from dextera_build.sim.experts.squeeze import LiftTogether, Squeeze, in_object, squeezes
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment

Progress = Callable[[int, int, str], None]
T = TypeVar("T")
ENOUGH = 24
"""Free paths among which the most comfortable are sought."""
LOOKED, FEW = 800, 12
"""Candidates after which this many free paths are enough, too."""
PLANNED = 3
"""Drawn starts from which candidates are sought, beside the photographed one."""
SOME = 12
"""Grasps of the giver that are combined with those of the receiver."""
PAIRS = 20
"""Pairs of grasps that are rehearsed at most."""
LEANS = (0.0, -0.4, 0.4, -0.8, 0.8)
"""Tilts of pushing fingers from straight down [rad]."""
ABOVE_M = (0.16, 0.07)
"""Heights of the approach above the start of a push [m]."""
HANDS_APART_M = 0.10
"""Smallest distance of two palms at one object [m]."""


class Practised:
    """The operator that did best in rehearsal and is free of collisions.

    Args:
        rehearsed: Candidates, best first.
        room: The task's collision checker.
        plan: New candidates from a state, most comfortable first.
    """

    def __init__(self, rehearsed: list[Rehearsed], room: Room, plan: Callable[[State], list[Candidate]]) -> None:
        self.rehearsed = rehearsed
        self._room, self._plan = room, plan
        self._now = rehearsed[0].candidate.operator

    def begin(self, state: State) -> None:
        """Choose the first free path from `state`, or a new one; if none is free, the best one reports the reason."""
        for one in self.rehearsed:
            if self._room.comfort(one.candidate.operator.phases(state), state) is not None:
                self._now = one.candidate.operator
                break
        else:
            new = self._plan(state) or [self.rehearsed[0].candidate]
            self._now = new[0].operator
        self._now.begin(state)

    def command(self, state: State) -> Command | None:
        """The next command of that path."""
        return self._now.command(state)


def practise(driver: Driver, progress: Progress = lambda done, total, what: None) -> Practised:
    """Find the scripted operator of the driver's task, with the nearest limb that can reach, or those it names.

    Args:
        driver: Its environment is used and left in an arbitrary state.
        progress: Receives the progress of the rehearsal.

    Raises:
        RuleError: The robot's hand or the task yields no candidates, or none succeeded.
    """
    environment = driver.environment
    task = environment.task
    environment.begin(starts.photographed(environment.bundle, environment.model))
    candidates = 0
    first = ""
    for limbs, expert in teams(environment):
        for limb in limbs:
            _check_hand(environment.bundle.robot, limb, expert.against)
        reach = Reach(environment.bundle.robot, *limbs)
        room = Room(environment, reach)
        found = _found(driver, expert, reach, room)
        candidates, first = candidates + len(found), first or next((each.name for each in found), "")
        rehearsed = rehearse(driver, found, progress) if found else []
        if rehearsed:
            return Practised(rehearsed, room, functools.partial(expert.plan, environment, reach, room))
    if not candidates:
        raise RuleError(
            f"`{task.object}` is out of reach: no way to take hold of it that the arm can go",
            code="DXB-B250",
            hint="move the base, see `align.base`",
        )
    raise RuleError(
        f"no rehearsal of `{task.name}` succeeded",
        code="DXB-B251",
        facts={"candidates": candidates, "first": first},
        hint="look at the task's pictures: is the object free, and is the goal possible?",
    )


def _found(driver: Driver, expert: Expert, reach: Reach, room: Room) -> list[Candidate]:
    """Candidates from several starts in turn: what the arm cannot reach from one of them, it may from another."""
    environment = driver.environment
    found: dict[str, Candidate] = {}
    plans: list[list[Candidate]] = []
    for start in [starts.photographed(environment.bundle, environment.model), *drawn(driver, PLANNED)]:
        environment.begin(start)
        plans.append([replace(each, start=start) for each in expert.plan(environment, reach, room, driver.state())])
    for each in itertools.chain.from_iterable(itertools.zip_longest(*plans)):
        if each is not None:
            found.setdefault(each.name, each)
    return list(found.values())


def teams(environment: Environment) -> list[tuple[tuple[str, ...], Expert]]:
    """Limbs and the experts with which they may do the task, likeliest first.

    Raises:
        RuleError: There is no scripted operator of its primitive.
    """
    task, robot = environment.task, environment.bundle.robot
    experts = [expert for expert in EXPERTS if expert.primitive == task.primitive]
    if not experts:
        raise RuleError(
            f"there is no scripted operator of primitive `{task.primitive}`",
            code="DXB-B253",
            facts={"operators": listing(sorted({expert.primitive for expert in EXPERTS}))},
            hint="demonstrate the task by other means",
        )
    nearest = _limbs(environment)
    found: list[tuple[tuple[str, ...], Expert]] = []
    for expert in experts:
        if expert.hands == 1 and len(task.limbs) < 2:
            found += [((limb,), expert) for limb in nearest]
        elif expert.hands == 2 and len(robot.limbs) > 1 and len(task.limbs) != 1:
            found.append((tuple(nearest[:2]), expert))
    return found


def _limbs(environment: Environment) -> list[str]:
    """The limbs that may do the task, the one whose palm is nearest to its object first; a goal may name them."""
    robot = environment.bundle.robot
    if ordered := environment.primitive.ordered():
        return list(ordered)
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


def _reorients(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Grasps of the task's object to hold it at its target pose."""
    return _grasps(environment, reach, room, state, lambda grasp: Reorient(environment, reach, grasp))


def _grasps(
    environment: Environment, reach: Reach, room: Room, state: State, made: Callable[[Grasp], Planned]
) -> list[Candidate]:
    """Collision-free grasps of the task's object from the photographed start, most comfortable first."""
    found = (Candidate(each.name, each.way, made(each)) for each in _grips(environment, reach))
    return _comfortable(found, room, state)


def _grips(environment: Environment, reach: Reach) -> list[Grasp]:
    points = environment.bundle.objects[environment.task.object].points.astype(np.float64)
    return _mixed(list(candidates(points, reach.grips, reach.fingers)), lambda grasp: grasp.way)


def _mixed(items: list[T], way: Callable[[T], str] = lambda item: "") -> list[T]:
    """In an order that is always the same and looks random, all ways taking turns."""
    drawn = [items[number] for number in np.random.default_rng(0).permutation(len(items))]
    return taking_turns(drawn, [way(each) for each in drawn])


def _comfortable(found: Iterable[Candidate], room: Room, state: State) -> list[Candidate]:
    """The first candidates with a free path, most comfortable first, the kinds taking turns."""
    free: list[tuple[float, Candidate]] = []
    for number, each in enumerate(found):
        comfort = room.comfort(each.operator.phases(state), state)
        free += [(comfort, each)] if comfort is not None else []
        if len(free) >= (ENOUGH if number < LOOKED else FEW):
            break
    comfortable = [each for _, each in sorted(free, key=lambda one: -one[0])]
    return taking_turns(comfortable, [each.way for each in comfortable])


def _lifts_together(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Two hands that press on opposite sides of the task's object and lift it."""
    return _together(environment, reach, room, state, lambda way: LiftTogether(environment, reach, way))


def _places_together(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Two hands that carry the task's object between them."""
    return _together(environment, reach, room, state, lambda way: PlaceTogether(environment, reach, way))


def _together(
    environment: Environment, reach: Reach, room: Room, state: State, made: Callable[[Squeeze], Planned]
) -> list[Candidate]:
    name = environment.task.object
    points = environment.bundle.objects[name].points.astype(np.float64)
    palms = {limb: palm for limb, (palm, _) in reach.hands(state).items()}
    ways = _mixed(list(squeezes(points, reach, in_object(state.objects[name], palms))), lambda each: each.way)
    return _comfortable((Candidate(each.name, each.way, made(each)) for each in ways), room, state)


def _handovers(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Pairs of grasps, and where the object changes hands, most comfortable first."""
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
    for given, meeting in tried:
        solved = giver.arm.solve(meeting @ given.palm, giver.joints(state), posture=giver.arm.home)
        if not solved.reached():
            continue
        there = _handed(state, giver, solved.joints, given.closed, name, meeting)
        for received in (each for each in takes if _far_apart(given, each)):
            operator = Handover(environment, reach, meeting, given, received)
            comfort = room.comfort([operator.given_up(there)], there)
            if comfort is not None:
                way = f"{given.way} to {received.way}"
                found.append((comfort, Candidate(f"{given.name}, then {received.name}", way, operator)))
                break
        if len(found) >= PAIRS:
            break
    ordered = [each for _, each in sorted(found, key=lambda one: -one[0])]
    return taking_turns(ordered, [each.way for each in ordered])


def _given(room: Room, giver: Reach, grasp: Grasp, name: str, state: State) -> float | None:
    up = room.up
    return room.comfort([{giver.limb: grasp.taking(name, state.objects[name], up)}], state)


def _handed(
    state: State, giver: Reach, joints: np.ndarray, fingers: np.ndarray, name: str, meeting: np.ndarray
) -> State:
    """The state in which the giver holds the object at the meeting place."""
    moved = state.joints.copy()
    moved[giver.places(giver.arm.joints)] = joints
    return State(moved, {**state.objects, name: meeting}, state.displacement)


def _far_apart(given: Grasp, received: Grasp) -> bool:
    """Whether two hands in these grasps have room beside one another."""
    return float(np.linalg.norm(given.palm[:3, 3] - received.palm[:3, 3])) > HANDS_APART_M


def _slides(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Pushes of the task's object along its support, most comfortable first."""
    turns = (0.0, 0.4, -0.4, 0.8, -0.8, np.pi / 2, -np.pi / 2, np.pi)
    pitches = (0.0, 0.5, -0.5, 1.0, -1.0)
    ways = [
        Stroke(lean, turn, pitch, above_m=above)
        for pitch, turn, lean, above in itertools.product(pitches, turns, LEANS, ABOVE_M)
    ]
    return _comfortable([_pushed(way, Push(environment, reach, way)) for way in ways], room, state)


def _swings(environment: Environment, reach: Reach, room: Room, state: State) -> list[Candidate]:
    """Pushes of the task's joint that the arm can follow, simplest first."""
    pitches, turns = (0.0, 0.5, -0.5, 1.0, -1.0), (0.0, 0.3, -0.3, 0.6, -0.6)
    ways = [Swing(lean, turn, pitch) for pitch in pitches for turn in turns for lean in LEANS]
    found = [_pushed(way, Articulate(environment, reach, way)) for way in ways]
    return [each for each in found if _goes(each, reach, state)]


def _goes(candidate: Candidate, reach: Reach, state: State) -> bool:
    try:
        reach.check(candidate.operator.phases(state), state)
    except OutOfReach:
        return False
    return True


def _pushed(way: Stroke | Swing, operator: Planned) -> Candidate:
    lean, turn, pitch = np.degrees([way.lean_rad, way.turn_rad, way.pitch_rad])
    name = f"push, fingers leaning {lean:.0f} deg, turned {turn:.0f} deg, pitched {pitch:.0f} deg"
    name += f", from {1000 * way.above_m:.0f} mm above"
    return Candidate(name, f"push {turn:.0f} {pitch:.0f}", operator)


@dataclass(frozen=True)
class Expert:
    """A scripted operator of a primitive."""

    primitive: str
    """The primitive."""
    against: str
    """The grip that it needs, see `Grip.against`."""
    plan: Callable[[Environment, Reach, Room, State], list[Candidate]]
    """Candidates of its limbs from the photographed start, likeliest first."""
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
