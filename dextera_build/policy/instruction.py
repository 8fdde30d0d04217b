"""The task in words, for policies that take language; data sets and requests have the same words."""

from __future__ import annotations

import re

from dextera_build.artifacts.tasks.task import TaskSpec


def of_task(task: TaskSpec) -> str:
    """The name of a task in words: `CloseLaptop` is `close laptop`."""
    return " ".join(re.findall(r"[A-Z]?[^A-Z]+|[A-Z]+", task.name)).lower()
