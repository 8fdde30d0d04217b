"""All primitives, by name.

They are listed explicitly, because static imports make a primitive's code part of the keys of the rules that use it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dextera_build.artifacts.task import TaskObject, TaskSpec
from dextera_build.sim.primitives.articulate import Articulate
from dextera_build.sim.primitives.base import Primitive
from dextera_build.sim.primitives.handover import Handover
from dextera_build.sim.primitives.lift import Lift
from dextera_build.sim.primitives.pick_and_place import Place
from dextera_build.sim.primitives.pick_and_reorient import Reorient
from dextera_build.sim.primitives.push import Push

KINDS: Mapping[str, type[Primitive[Any]]] = {
    kind.name: kind for kind in (Lift, Articulate, Push, Reorient, Place, Handover)
}
"""Name -> primitive."""


def of(task: TaskSpec, objects: Mapping[str, TaskObject] | None = None) -> Primitive[Any]:
    """The primitive of a task.

    Args:
        task: The objective.
        objects: Body -> object of the task's model.
    """
    return KINDS[task.primitive](task, objects)
