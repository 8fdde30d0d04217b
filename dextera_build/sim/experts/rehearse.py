"""Choose how to do a task by trial: rehearse candidates in the task's own world and keep the best.

A scripted operator is thus a function of the task alone, without object-specific code.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Start
from dextera_build.artifacts.tasks.task import TaskBundle, TaskSpec
from dextera_build.errors import RuleError
from dextera_build.geometry import poses, transforms
from dextera_build.sim.control.operator import Operator, State
from dextera_build.sim.experts.acting import acting
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.motion import Plan
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.seeds import seed_of

TRIED = 32
"""Number of candidates tried once at their own start and once under hard conditions."""
GOOD = 12
"""Number of candidates that succeeded in both at which no more are tried."""
FINAL = 8
"""Number of candidates with the least stray that are rehearsed from random starts."""
STARTS = 6
"""Number of random starts."""
HARD = 0.9
"""Position of the hard start between nominal and the heavy, slippery and weak ends of the twin's intervals."""
STRAY_M_RAD = 0.1
"""Displacement equivalent to a rotation by one radian [m]."""


T = TypeVar("T")


class Planned(Operator, Protocol):
    """An operator with an inspectable plan."""

    def phases(self, state: State) -> list[Plan]:
        """The plan from `state`, phase by phase."""

    def comfort(self, room: CollisionCheck, state: State) -> float | None:
        """Comfort of the arms along the plan from `state`, higher is better; None if it is not free of collisions."""


@dataclass(frozen=True)
class Candidate:
    """A candidate plan for the task."""

    name: str
    """Human-readable description."""
    way: str
    """Kind of motion; candidates of one kind differ in details."""
    operator: Planned
    """The operator to rehearse."""
    start: Start | None = None
    """Start at which its path was found free of collisions; None: the photographed one."""


@dataclass(frozen=True)
class Rehearsed:
    """The outcome of a candidate."""

    candidate: Candidate
    """The rehearsed candidate."""
    stray: float
    """Unintended motion of the object in the hand or on its support [rad, see `STRAY_M_RAD`]."""
    passed: int
    """Number of successful starts."""
    of: int
    """Number of rehearsed starts."""
    reason: str = ""
    """Reason of the last failure."""


def rehearse(
    driver: Driver,
    candidates: Sequence[Candidate],
    progress: Callable[[int, int, str], None],
    failed: Counter[str] | None = None,
    good: int = GOOD,
) -> list[Rehearsed]:
    """Rehearse candidates and return those that succeeded in a trial, best first.

    Args:
        driver: The task's driver.
        candidates: Candidates, likeliest first.
        progress: Receives the progress.
        failed: Receives the reasons of candidates that succeeded in no trial.
        good: Number of candidates that succeeded in both first trials at which no more are tried.
    """
    bundle = driver.environment.bundle
    photographed = starts.photographed(bundle, driver.environment.model)
    tried: list[Rehearsed] = []
    last = min(FINAL, good)
    total = min(TRIED, len(candidates)) + last
    for number, candidate in enumerate(candidates[:TRIED]):
        progress(number, total, candidate.name)
        first = candidate.start or photographed
        found = _rehearsed(driver, candidate, [first, _hard(bundle, first)], patient=False)
        if found.passed:
            tried.append(found)
        elif failed is not None:
            failed[found.reason] += 1
        if sum(one.passed == one.of for one in tried) >= good:
            break
    tried.sort(key=lambda one: (-one.passed, one.stray))
    begun = drawn(driver, STARTS)
    final: list[Rehearsed] = []
    # The best of every kind first, because a kind without free space may be the only one that fails.
    finalists = taking_turns(tried, [one.candidate.way for one in tried])[:last]
    for number, one in enumerate(finalists):
        progress(total - last + number, total, one.candidate.name)
        found = _rehearsed(driver, one.candidate, begun, patient=True)
        final.append(
            replace(one, stray=max(one.stray, found.stray), passed=one.passed + found.passed, of=one.of + found.of)
        )
    # The others are less likely, but may succeed where the first ones have no free space.
    others = [one for one in tried if one not in finalists]
    return sorted(final, key=lambda one: (-one.passed, one.stray)) + others


def stray(episode: Episode, task: TaskSpec, names: Sequence[str], limbs: Sequence[str] = ()) -> float:
    """Unintended motion of the task's object; see `Rehearsed.stray`.

    Args:
        episode: Episode of the task.
        task: The task.
        names: Bodies of `Episode.objects`.
        limbs: Limbs of `Episode.hand`.
    """
    touching = [segment.first for segment in episode.segments if segment.contact]
    still = catalogue.kind(task.primitive).still
    if not touching or not still:
        return 0.0
    objects = episode.objects[:, list(names).index(task.object)]
    first, last = poses.to_matrix(objects[touching[0]]), poses.to_matrix(objects[-1])
    if still == "in hand":
        # The palm is at rest relative to the object only at the end of the approach; undo earlier motion.
        palm = episode.hand[:, acting(episode, limbs)[0]]
        first = transforms.invert(poses.to_matrix(palm[_near(episode, touching[0])])) @ first
        last = transforms.invert(poses.to_matrix(palm[-1])) @ last
    moved = transforms.invert(first) @ last
    return transforms.angle(moved[:3, :3]) + float(np.linalg.norm(moved[:3, 3])) / STRAY_M_RAD


def taking_turns(items: Sequence[T], ways: Sequence[str]) -> list[T]:
    """Round-robin: the first item of every way, then the second of every way, and so on."""
    seen: Counter[str] = Counter()
    ranks = []
    for way in ways:
        ranks.append(seen[way])
        seen[way] += 1
    return [items[number] for number in sorted(range(len(items)), key=ranks.__getitem__)]


def _near(episode: Episode, first: int) -> int:
    """The first step from `first` on at which the palm is at rest before the lift."""
    lift = next((segment.first for segment in episode.segments if segment.name == "lift"), len(episode.hand))
    return max(first, min(lift, len(episode.hand)) - 1)


def _rehearsed(driver: Driver, candidate: Candidate, drawn: Sequence[Start], *, patient: bool) -> Rehearsed:
    bundle, passed, worst, reason = driver.environment.bundle, 0, 0.0, ""
    for start in drawn:
        episode = driver.run(candidate.operator, start, origin="operator")
        passed += episode.success
        if episode.success:
            worst = max(worst, stray(episode, bundle.task, tuple(bundle.objects), bundle.robot.limb_names))
        reason = episode.reason or reason
        if not episode.success and not patient:
            break
    return Rehearsed(candidate, worst, passed, len(drawn), reason)


def drawn(driver: Driver, most: int) -> list[Start]:
    """Starts of rehearsals, deterministic; fewer than `most` if a task is crowded."""
    found = []
    for number in range(most):
        with contextlib.suppress(RuleError):
            found.append(driver.environment.draw(seed_of("rehearsal", number)))
    return found


def _hard(bundle: TaskBundle, start: Start) -> Start:
    """The start with weak gains and a slippery object, heavy if it is carried, otherwise light."""
    name, width = bundle.task.object, bundle.task.reset.dynamics * HARD
    thing = bundle.objects[name]
    mass = 1.0 + width * (thing.mass_scale[catalogue.kind(bundle.task.primitive).carries] - 1.0)
    friction = max(0.05, thing.friction - width * thing.friction_sigma)
    return start.model_copy(
        update={
            "mass_scale": {**start.mass_scale, name: mass},
            "friction": {**start.friction, name: friction},
            "gain_scale": 1.0 - starts.GAINS * width,
        }
    )
