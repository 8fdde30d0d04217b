"""Runs one call on a node of a Ray cluster: downloads its inputs, runs it, uploads its output.

The call runs in a process of the local pool, so its log, usage and death are reported as in a local build.
This module does not import Ray.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from dextera_build.errors import DxbError
from dextera_build.remotes.spec import Spec, open_remote
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.protocol import Ended, Report, Task
from dextera_build.workers.staging import Staging

STORE = "DXB_NODE_STORE"
"""Variable with the folder of a node's store; nodes on one machine may share a store."""
_TICK_S = 0.5
"""Polling interval for silent calls, at which Ray can interrupt them [s]."""


@dataclass(frozen=True)
class Setup:
    """Settings for the workers of one build."""

    runner: str
    """`module:function` that executes a task."""
    shared: Spec
    """The remote for blobs."""
    environment: Mapping[str, str] = field(default_factory=dict)


class NodeWorker:
    """Runs calls on a node, with its store and a pool of one process that is reused between calls.

    Args:
        setup: Settings of the build.
    """

    def __init__(self, setup: Setup) -> None:
        home = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
        self._store = Store(Path(os.environ.get(STORE) or home / "dxb" / "node"))
        # Until this process ends: keeps garbage collection from removing downloaded inputs.
        self._announced = self._store.running.announced()
        self._announced.__enter__()
        self._staging = Staging(self._store, open_remote(setup.shared))
        self._pool = LocalExecutor(setup.runner, Capacity(), setup.environment)

    def run(self, task: Task) -> Iterator[Report]:
        """Run a call with this node's store and project instead of the driver's; the last report is an `Ended`."""
        self._staging.bring(task.inputs.values())
        # Ray has made the folder with the project's code the working directory.
        self._pool.submit(replace(task, store=str(self._store.root), project=os.getcwd(), devices=_devices()))
        try:
            while True:
                for report in self._pool.poll(_TICK_S):
                    if isinstance(report, Ended):
                        yield self._delivered(task, report)
                        return
                    yield report
        except BaseException:
            self._pool.stop()
            raise

    def _delivered(self, task: Task, end: Ended) -> Ended:
        if end.reply is None:
            return end
        try:
            self._staging.send_made(end.reply)
        except DxbError as error:
            return replace(end, reply=None, error=error)
        if task.key:
            self._store.keep.drop(task.key)
        return end


_here: list[NodeWorker] = []
"""The worker of this process; Ray uses each process for only one build."""


def carry_out(setup: Setup, task: Task) -> Iterator[Report]:
    """Run a call in this process and yield its reports."""
    began = time.monotonic()
    try:
        if not _here:
            _here.append(NodeWorker(setup))
        yield from _here[0].run(task)
    except DxbError as error:
        yield Ended(task.ticket, time.monotonic() - began, b"", error=error)


class Holder:
    """An actor: its process runs call after call and keeps loaded weights."""

    def carry_out(self, setup: Setup, task: Task) -> Iterator[Report]:
        """See `carry_out`."""
        yield from carry_out(setup, task)


def _devices() -> tuple[str, ...]:
    """GPUs that Ray assigned to this worker."""
    return tuple(map(str, sys.modules["ray"].get_gpu_ids())) if "ray" in sys.modules else ()
