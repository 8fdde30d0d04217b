"""Planning of a scripted operator for a task: candidates are searched from several starts, and rehearsed."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.sim.control.operator import Command, Operator, OutOfReach, State
from dextera_build.sim.experts.candidates import ENOUGH, Expert, Search, experts
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import GOOD, Candidate, Rehearsed, drawn, rehearse
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment

Progress = Callable[[int, int, str], None]
PLANNED = 3
"""Largest number of random starts from which candidates are searched, in addition to the photographed one."""
SHOWN = 4
"""Number of reasons of failures that an error shows."""
FREE = 6
"""Number of joints of an arm that turns its hand freely."""
NEW = 3
"""Number of sufficient free paths in a new search, if no rehearsed path is free."""


class Practised:
    """The operator with the best rehearsal whose path is free of collisions.

    Args:
        rehearsed: Candidates, best first.
        expert: Source of new candidates if no rehearsed one has a free path.
        search: Context of the search.
    """

    def __init__(self, rehearsed: list[Rehearsed], expert: Expert, search: Search) -> None:
        self.rehearsed = rehearsed
        self._expert, self._search = expert, search
        self._now = rehearsed[0].candidate.operator

    def begin(self, state: State) -> None:
        """Choose the first free path from `state`, or a new one; if none is free, the best candidate raises."""
        for one in self.rehearsed:
            if one.candidate.operator.comfort(self._search.room, state) is not None:
                self._now = one.candidate.operator
                break
        else:
            new = self._expert.plan(replace(self._search, state=state, enough=NEW))
            self._now = (new or [self.rehearsed[0].candidate])[0].operator
        self._now.begin(state)

    def command(self, state: State) -> Command | None:
        """The next command of that path."""
        return self._now.command(state)


class Unable:
    """An operator without a plan: every start is out of reach.

    Args:
        reason: The reason.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason

    def begin(self, state: State) -> None:
        """Raise the reason.

        Raises:
            OutOfReach: Always.
        """
        raise OutOfReach(self.reason)

    def command(self, state: State) -> Command | None:
        """None."""
        return None


def practise(
    driver: Driver,
    progress: Progress = lambda done, total, what: None,
    *,
    anyway: bool = False,
    good: int = GOOD,
) -> Operator:
    """Find the scripted operator of the driver's task, with the nearest capable limb, or the limbs that the task names.

    Args:
        driver: Its environment is used and left in an arbitrary state.
        progress: Receives the progress of the rehearsal.
        anyway: If no rehearsal succeeded, return the operator of the likeliest candidate, or `Unable` if there is none,
            so that its attempts show the failure.
        good: Number of candidates that succeed in their first two trials at which no more are tried.

    Raises:
        RuleError: The robot's hand lacks a frame or a grip, the primitive has no script, or, unless `anyway`, the task
            yields no candidates or none succeeded.
    """
    environment = driver.environment
    task = environment.task
    photographed = starts.photographed(environment.bundle, environment.model)
    environment.begin(photographed)
    candidates: list[Candidate] = []
    failed, refused = Counter[str](), Counter[str]()
    likeliest: Operator | None = None
    for limbs, expert in teams(environment):
        # Every search knows the sizes of the photographed start, whatever an earlier one looked at.
        environment.begin(photographed)
        for limb in limbs:
            _check_hand(environment.bundle.robot, limb, expert.against)
        reach = Reach(environment.bundle.robot, *limbs)
        search = Search(environment, reach, CollisionCheck(environment, reach), driver.state(), min(ENOUGH, 4 * good))
        found = _found(driver, expert, search, min(PLANNED, good - 1))
        refused += search.room.refused
        if not found:
            continue
        candidates += found
        rehearsed = rehearse(driver, found, progress, failed, good)
        if rehearsed:
            return Practised(rehearsed, expert, search)
        # New plans are not searched where its path is not free: that would be slow and would not help.
        likeliest = likeliest or found[0].operator
    far = f"`{task.object}` is out of reach: no way to take hold of it that the arm can go"
    if anyway:
        return likeliest or Unable(far)
    if not candidates:
        raise RuleError(
            far,
            code="DXB-B250",
            facts=_few_joints(environment) | _reasons(refused),
            hint="move the base, see `align.base`",
        )
    raise RuleError(
        f"no rehearsal of `{task.name}` succeeded",
        code="DXB-B251",
        facts={"candidates": len(candidates), "first": candidates[0].name} | _reasons(failed),
        hint="look at the task's pictures: is the object free, and is the goal possible?",
    )


def _few_joints(environment: Environment) -> dict[str, str]:
    """What an arm with few joints cannot do, by limb."""
    limbs = environment.bundle.robot.limbs
    few = [f"`{name}` has {len(limb.arm)}" for name, limb in limbs.items() if len(limb.arm) < FREE]
    return {"joints": f"{', '.join(few)}, and a hand is turned freely by {FREE}"} if few else {}


def _reasons(failed: Counter[str]) -> dict[str, str]:
    told = ", ".join(f"{reason} ({count}x)" for reason, count in failed.most_common(SHOWN))
    return {"failed": told} if told else {}


def _found(driver: Driver, expert: Expert, search: Search, more: int) -> list[Candidate]:
    """Candidates from the photographed start and `more` drawn ones in turn, because reachability differs."""
    environment = driver.environment
    found: dict[str, Candidate] = {}
    plans: list[list[Candidate]] = []
    for start in [starts.photographed(environment.bundle, environment.model), *drawn(driver, more)]:
        environment.begin(start)
        here = replace(search, state=driver.state())
        plans.append([replace(each, start=start) for each in expert.plan(here)])
    for each in itertools.chain.from_iterable(itertools.zip_longest(*plans)):
        if each is not None:
            found.setdefault(each.name, each)
    return list(found.values())


def teams(environment: Environment) -> list[tuple[tuple[str, ...], Expert]]:
    """Limbs and the experts with which they may do the task, likeliest first.

    Raises:
        RuleError: The primitive has no script, or it is not in the key of the call that runs.
    """
    task, robot = environment.task, environment.bundle.robot
    nearest = _limbs(environment)
    found: list[tuple[tuple[str, ...], Expert]] = []
    for expert in experts(task.primitive):
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


def _check_hand(robot: RobotModel, limb: str, against: str) -> None:
    own = robot.limbs[limb]
    # Only what closes on an object has fingers that oppose one another.
    lone = "tip_thumb" if against == "thumb" else "tip"
    missing = ["palm"] * (not own.palm) + [lone] * (own.thumb is None if against == "thumb" else not own.tips)
    grips = {name: grip.against for name, grip in own.grips.items()}
    if missing or against not in grips.values():
        what = f"frame `{missing[0]}`" if missing else f"grip against `{against}`"
        raise RuleError(
            f"the robot has no {what}" if len(robot.limbs) == 1 else f"limb `{limb}` has no {what}",
            code="DXB-B252",
            facts={"frames": listing(sorted(robot.frames), most=20), "grips": listing(sorted(grips), most=20)},
            hint="add it to `frames`, `grips` or `limbs` of the robot's recipe",
        )
