"""Primitives by name; their code is found in folders, see `folders`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dextera_build.artifacts.tasks.task import TaskObject, TaskSpec
from dextera_build.sim.primitives import folders
from dextera_build.sim.primitives.base import Primitive


def kind(name: str) -> type[Primitive[Any]]:
    """The class of a primitive.

    Raises:
        RuleError: There is none, or it is not in the key of the call that runs.
    """
    found: type[Primitive[Any]] = folders.module(name, "primitive").Primitive
    return found


def of(task: TaskSpec, objects: Mapping[str, TaskObject] | None = None) -> Primitive[Any]:
    """The primitive of a task.

    Args:
        task: The objective.
        objects: Body -> object of the task's model.

    Raises:
        RuleError: See `kind`.
    """
    return kind(task.primitive)(task, objects)


def concerned(task: TaskSpec, objects: Mapping[str, TaskObject]) -> tuple[str, ...]:
    """The task's object, and the bodies that its goal names beside it: the container that it is put into.

    Args:
        task: The objective.
        objects: Body -> object of the task's model.

    Raises:
        RuleError: See `kind`.
    """
    return (task.object, *of(task, objects).others())
