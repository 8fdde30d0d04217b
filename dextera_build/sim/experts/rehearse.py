"""Choose how to do a task by trying: candidates are rehearsed in the task's own world and the best are kept.

A scripted operator is thus a function of the task alone; nothing of it is made for one object.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from dextera_build.artifacts.episode import Episode, Start
from dextera_build.artifacts.task import TaskBundle, TaskSpec
from dextera_build.errors import RuleError
from dextera_build.geometry import poses, transforms
from dextera_build.sim.control.operator import Operator, State
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.motion import Leg
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.seeds import seed_of

TRIED = 24
"""Candidates that are tried once as photographed and once under hard conditions."""
FINAL = 5
"""The steadiest of them that are rehearsed from drawn starts."""
STARTS = 6
"""Drawn starts of the final."""
HARD = 0.9
"""How far the hard start goes towards the heavy, slippery and weak ends of the twin's own intervals."""
STRAY_M_RAD = 0.1
"""Straying by this counts as much as straying by one radian [m]."""


T = TypeVar("T")


class Planned(Operator, Protocol):
    """An operator whose plan can be looked at."""

    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`."""


@dataclass(frozen=True)
class Candidate:
    """A way to do the task."""

    name: str
    """Description for people."""
    way: str
    """Ways of the same kind differ in detail; one of a kind is enough."""
    operator: Planned
    """It."""


@dataclass(frozen=True)
class Rehearsed:
    """The outcome of a candidate."""

    candidate: Candidate
    """It."""
    stray: float
    """How much the object moved where it was meant to stay: in the hand, or on its support [rad, see `STRAY_M_RAD`]."""
    passed: int
    """Starts from which it succeeded."""
    of: int
    """Starts that it was rehearsed from."""


def rehearse(
    driver: Driver, candidates: Sequence[Candidate], progress: Callable[[int, int, str], None]
) -> list[Rehearsed]:
    """Candidates that succeeded in both trials, the best first.

    Args:
        driver: Of the task.
        candidates: The likeliest first.
        progress: Is told how far it is.
    """
    bundle, model = driver.environment.bundle, driver.environment.model
    first = starts.photographed(bundle, model)
    tried: list[Rehearsed] = []
    total = min(TRIED, len(candidates)) + FINAL
    for number, candidate in enumerate(candidates[:TRIED]):
        progress(number, total, candidate.name)
        found = _rehearsed(driver, candidate, [first, _hard(bundle, first)], patient=False)
        if found.passed:
            tried.append(found)
    tried.sort(key=lambda one: (-one.passed, one.stray))
    drawn = [start for number in range(STARTS) if (start := _drawn(driver, number)) is not None]
    final: list[Rehearsed] = []
    # The best of every way first: where one way has no room, another one may.
    finalists = taking_turns(tried, [one.candidate.way for one in tried])[:FINAL]
    for number, one in enumerate(finalists):
        progress(total - FINAL + number, total, one.candidate.name)
        found = _rehearsed(driver, one.candidate, drawn, patient=True)
        final.append(
            replace(one, stray=max(one.stray, found.stray), passed=one.passed + found.passed, of=one.of + found.of)
        )
    return sorted(final, key=lambda one: (-one.passed, one.stray))


def stray(episode: Episode, task: TaskSpec, names: Sequence[str]) -> float:
    """How much the task's object moved where it was meant to stay; see `Rehearsed.stray`.

    Args:
        episode: Of the task.
        task: The task.
        names: Bodies of `Episode.objects`.
    """
    touching = [segment.first for segment in episode.segments if segment.contact]
    if not touching:
        return 0.0
    objects = episode.objects[:, list(names).index(task.object)]
    first, last = poses.to_matrix(objects[touching[0]]), poses.to_matrix(objects[-1])
    if task.primitive == "lift":
        # The palm stands still relative to the object only once it has come near: what came before is undone here.
        first = transforms.invert(poses.to_matrix(episode.hand[_near(episode, touching[0])])) @ first
        last = transforms.invert(poses.to_matrix(episode.hand[-1])) @ last
    moved = transforms.invert(first) @ last
    return transforms.angle(moved[:3, :3]) + float(np.linalg.norm(moved[:3, 3])) / STRAY_M_RAD


def taking_turns(items: Sequence[T], ways: Sequence[str]) -> list[T]:
    """The first item of every way, then the second of every way, and so on; in order otherwise."""
    seen: Counter[str] = Counter()
    ranks = []
    for way in ways:
        ranks.append(seen[way])
        seen[way] += 1
    return [items[number] for number in sorted(range(len(items)), key=ranks.__getitem__)]


def _near(episode: Episode, first: int) -> int:
    """The step from `first` on at which the palm has come to rest before the lift."""
    lift = next((segment.first for segment in episode.segments if segment.name == "lift"), len(episode.hand))
    return max(first, min(lift, len(episode.hand)) - 1)


def _rehearsed(driver: Driver, candidate: Candidate, drawn: Sequence[Start], *, patient: bool) -> Rehearsed:
    bundle, passed, worst = driver.environment.bundle, 0, 0.0
    for start in drawn:
        episode = driver.run(candidate.operator, start, origin="operator")
        passed += episode.success
        worst = max(worst, stray(episode, bundle.task, tuple(bundle.objects)) if episode.success else 0.0)
        if not episode.success and not patient:
            break
    return Rehearsed(candidate, worst, passed, len(drawn))


def _drawn(driver: Driver, number: int) -> Start | None:
    environment = driver.environment
    try:
        return starts.draw(environment.bundle, environment.model, seed_of("rehearsal", number))
    except RuleError:
        return None


def _hard(bundle: TaskBundle, start: Start) -> Start:
    """The start with weak gains and the task's object slippery and, where it is lifted, heavy; else light."""
    name, width = bundle.task.object, bundle.task.reset.dynamics * HARD
    thing = bundle.objects[name]
    mass = 1.0 + width * (thing.mass_scale[bundle.task.primitive == "lift"] - 1.0)
    friction = max(0.05, thing.friction - width * thing.friction_sigma)
    return start.model_copy(
        update={
            "mass_scale": {**start.mass_scale, name: mass},
            "friction": {**start.friction, name: friction},
            "gain_scale": 1.0 - starts.GAINS * width,
        }
    )
