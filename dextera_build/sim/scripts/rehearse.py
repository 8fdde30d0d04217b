"""Choose how to do a task by trying: candidates are rehearsed in the task's own world and the best are kept.

A scripted operator is thus a function of the task alone; nothing of it is made for one object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from dextera_build.artifacts.episode import Start
from dextera_build.artifacts.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim import starts
from dextera_build.sim.drive import Driver
from dextera_build.sim.operator import Operator, State
from dextera_build.sim.scripts.motion import Leg
from dextera_build.sim.seeds import seed_of

STARTS = 6
"""Drawn starts that a candidate is rehearsed from, beside the photographed one and a hard one."""
HARD = 0.9
"""How far the hard start goes towards the heavy, slippery and weak ends of the twin's own intervals."""
MOST = 40
"""Candidates that are rehearsed at most."""
KEEP = 3
"""Ways that never failed that are looked for; the others serve where the first has no room."""


class Planned(Operator, Protocol):
    """An operator whose plan can be looked at."""

    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`."""


@dataclass(frozen=True)
class Candidate:
    """A way to do the task."""

    name: str
    """What it is, for people."""
    way: str
    """Ways of the same kind differ in detail; one of a kind is enough."""
    operator: Planned
    """It."""


@dataclass(frozen=True)
class Rehearsed:
    """What came of a candidate."""

    candidate: Candidate
    """It."""
    passed: int
    """Starts from which it succeeded."""
    of: int
    """Starts that it was rehearsed from; fewer than all where it was given up."""


def rehearse(
    driver: Driver, candidates: Sequence[Candidate], progress: Callable[[int, int, str], None]
) -> list[Rehearsed]:
    """Candidates that succeeded at least once, the best first.

    Args:
        driver: Of the task.
        candidates: The likeliest first.
        progress: Is told how far it is.
    """
    drawn = _starts(driver)
    found: list[Rehearsed] = []
    tried, whole = 0, 0
    for candidate in candidates:
        sure = {one.candidate.way for one in found if one.passed == len(drawn)}
        if tried == MOST or len(sure) == KEEP:
            break
        if candidate.way in sure:
            continue
        progress(tried, min(MOST, len(candidates)), candidate.name)
        tried += 1
        passed = of = 0
        for start in drawn:
            passed += driver.run(candidate.operator, start, origin="operator").success
            of += 1
            # Two failures are too many, and so is one from the photographed start.
            if passed < max(1, of - 1):
                break
        if passed:
            found.append(Rehearsed(candidate, passed, of))
        whole += passed == len(drawn)
        if whole and tried >= MOST // 2:
            break
    return sorted(found, key=lambda one: (-one.passed, one.of))


def _starts(driver: Driver) -> list[Start]:
    bundle, model = driver.environment.bundle, driver.environment.model
    first = starts.photographed(bundle, model)
    drawn = [first, _hard(bundle, first)]
    for number in range(STARTS):
        try:
            drawn.append(starts.draw(bundle, model, seed_of("rehearsal", number)))
        except RuleError:
            continue
    return drawn


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
