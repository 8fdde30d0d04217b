"""Goals of tasks, in the world frame [m, rad].

In the observations of policies a goal is a vector with named components, in the robot's base frame like all
observations.
"""

from __future__ import annotations

from typing import Any

from pydantic import model_validator

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

    @model_validator(mode="before")
    @classmethod
    def _with_names(cls, fields: Any) -> Any:
        """Goals that were stored without names are of one of the first six primitives."""
        return fields if cls is not Goal or "names" in fields else {**fields, "names": _former_names(**fields)}


_POSE = tuple(f"target_{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz"))
_FORMER = {"lift": ("rise",), "push": ("x", "y", "heading_x", "heading_y")}


def _former_names(primitive: str, joints: Any = (), receiver: str = "", **_: Any) -> tuple[str, ...]:
    if primitive == "articulate":
        return tuple(joints)
    return (f"receiver_is_{receiver}",) if primitive == "handover" else _FORMER.get(primitive, _POSE)


def former(
    primitive: str, height_m: float = 0.0, joints: dict[str, float] | None = None, tolerance: float = 0.0
) -> Goal:
    """The goal of a task stored when lifting and articulating were the only primitives."""
    own = {"joints": joints or {}, "tolerance": tolerance} if primitive == "articulate" else {"height_m": height_m}
    return Goal.model_validate({"primitive": primitive, **own})
