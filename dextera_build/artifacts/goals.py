"""Goals of tasks, in the world frame [m, rad].

In the observations of policies a goal is a vector with named components, in the robot's base frame like all
observations.
"""

from __future__ import annotations

from typing import Any

from dextera_build.artifacts.value import Open


class Goal(Open):
    """The goal of a task: the name of its primitive, and the fields of that primitive's own type.

    The type is in `primitive.py` of the primitive, see `dextera_build.sim.primitives`. It is no part of this one, so
    that a new primitive changes no stored type.
    """

    primitive: str
    """Kind of objective: `lift`."""
    names: tuple[str, ...]
    """Names of its numbers in the observations of policies."""


def untyped(goal: Any) -> Any:
    """A goal without its primitive's own type, as it is read back from a store; anything else as it is."""
    return Goal(**goal.model_dump()) if isinstance(goal, Goal) else goal
