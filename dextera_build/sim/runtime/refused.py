"""Reasons why no start of a task can be drawn: statistics of the rejected draws."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim.model.compose import ROBOT

SHOWN = 4
"""Maximum number of pairs and objects named in the error."""


CRASH, BESIDE, DONE = "without collisions", "with all objects on the support", "away from its goal"
"""Requirements that a rejected draw violates."""


class Refused:
    """Counts the reasons of rejected draws."""

    def __init__(self) -> None:
        self._causes: Counter[str] = Counter()
        self._pairs: Counter[str] = Counter()
        self._off: Counter[str] = Counter()

    def note(self, pairs: Iterable[str], off: Iterable[str]) -> None:
        """Count one draw.

        Args:
            pairs: Pairs of bodies that collide, each as text.
            off: Objects that are not above the support; if both are empty, the goal is already reached.
        """
        colliding, beside = list(pairs), list(off)
        self._causes[CRASH if colliding else BESIDE if beside else DONE] += 1
        self._pairs.update(colliding)
        self._off.update(beside)

    def error(self, bundle: TaskBundle) -> RuleError:
        """The error of a task without an accepted draw."""
        cause = self._causes.most_common(1)[0][0]
        facts = {"draws": f"{self._causes.total()}, none accepted"}
        facts |= {
            name: ", ".join(f"{key} ({count}x)" for key, count in counts.most_common(SHOWN))
            for name, counts in (("collisions", self._pairs), ("off the support", self._off))
            if counts
        }
        if self._causes[DONE]:
            facts["goal reached at once"] = f"{self._causes[DONE]}x"
        return RuleError(
            f"no start of `{bundle.task.name}` {cause} was found",
            code="DXB-B220",
            facts={**facts, "ranges": _ranges(bundle.task.reset)},
            hint=self._hint(cause),
        )

    def _hint(self, cause: str) -> str:
        if cause == DONE:
            return "choose a goal farther from the photographed place of the object"
        if cause == CRASH and ROBOT in self._pairs.most_common(1)[0][0]:
            return "move the robot with `position_m` of `align.base`, or make the ranges of `reset` smaller"
        return "make the ranges of `reset` smaller"


def _ranges(reset: Reset) -> str:
    """Half ranges of a start, in the options' own units."""
    turns = {"yaw_deg": reset.yaw_rad, "robot_deg": reset.robot_rad, "joint_deg": reset.joint_rad}
    parts = {"position_m": reset.position_m, "clutter_m": reset.clutter_m}
    parts |= {name: float(np.degrees(value)) for name, value in turns.items()}
    return ", ".join(f"{name} {value:g}" for name, value in parts.items() if value) or "none"
