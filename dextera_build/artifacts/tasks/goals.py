"""Goals of tasks, in the world frame [m, rad].

In the observations of policies a goal is a vector with named components, in the robot's base frame like all
observations.
"""

from __future__ import annotations

from dextera_build.artifacts.core.value import Open


class Goal(Open):
    """The goal of a task: the name of its primitive, and the fields of that primitive's own type.

    The type is in `primitive.py` of the primitive, see `dextera_build.sim.primitives`. It is no part of this one, so
    that a new primitive changes no stored type.
    """

    primitive: str
    """Kind of objective: `lift`."""
    names: tuple[str, ...]
    """Names of its numbers in the observations of policies."""
