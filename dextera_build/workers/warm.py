"""Workers that keep a loaded model: which of them takes a task, and which must go to make room.

A model is loaded once and serves many nodes, so a task goes to the worker that holds its weights. An idle worker's
model takes memory that admission does not count, so idle ones end, the least recently used first, before a task would
not fit beside them, and after a while without work.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, TypeVar

from dextera_build.workers.capacity import Capacity
from dextera_build.workers.protocol import Task

IDLE_S = 60.0
"""After this time without work a worker that holds a model ends [s]."""


class Worker(Protocol):
    """State of a worker."""

    devices: tuple[str, ...]
    task: Task | None
    holds: tuple[str, ...]
    """Weights of the model that it has loaded."""
    held_gb: float
    """Its memory while it is idle [GiB]."""
    held_gpu_gb: float
    """Memory of its GPU that the model takes [GiB]."""
    idle_since: float


W = TypeVar("W", bound=Worker)


def takes(worker: Worker, task: Task) -> bool:
    """Whether a worker may take a task: one without a model goes to no worker that holds one.

    Its measured memory would otherwise include the model, and the next task would find its model's worker busy.
    """
    return bool(task.weights) or not worker.holds


def choose(idle: Sequence[W], task: Task) -> W | None:
    """The idle worker that takes a task: the one that holds its weights, else an empty one, else the oldest.

    Of several empty ones the first: it has imported modules that each of them would otherwise import in turn.
    """

    def rank(worker: W) -> tuple[bool, float]:
        return worker.holds != task.weights, worker.idle_since if worker.holds else -math.inf

    return min((worker for worker in idle if takes(worker, task)), key=rank, default=None)


def surplus(workers: Sequence[W], task: Task, chosen: W | None, capacity: Capacity) -> list[W]:
    """Idle workers with models that must end before a task starts, the least recently used first.

    Args:
        workers: All workers.
        task: The task.
        chosen: The worker that takes it.
        capacity: Resources that all share.
    """
    others = [worker for worker in workers if worker is not chosen]
    held = sorted((w for w in others if w.task is None and w.holds), key=lambda worker: worker.idle_since)
    running = [w.task for w in others if w.task is not None]
    must_go: list[W] = []
    sizes = {gpu.id: gpu.memory_gb for gpu in capacity.gpus}
    for device in task.devices:
        used = task.needs.gpu_gb + sum(other.needs.gpu_gb for other in running if device in other.devices)
        mates = [worker for worker in held if device in worker.devices]
        must_go += _oldest(mates, [w.held_gpu_gb for w in mates], sizes.get(device, 0.0) - used)
    used = task.needs.memory_gb + sum(other.needs.memory_gb for other in running)
    rest = [worker for worker in held if worker not in must_go]
    return must_go + _oldest(rest, [w.held_gb for w in rest], capacity.memory_gb - used)


def _oldest(held: list[W], amounts: list[float], room: float) -> list[W]:
    """The first of `held` that must go for the rest to fit into `room`."""
    gone: list[W] = []
    for place, worker in enumerate(held):
        if sum(amounts[place:]) <= room:
            break
        gone.append(worker)
    return gone
