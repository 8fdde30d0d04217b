"""One call on a node of a Ray cluster: download its inputs, run it, upload what it made.

The call runs in a process of the local pool, so its output, its usage and its death are reported as on one machine.
Nothing here imports Ray.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from dextera_build.errors import DxbError, MachineError, from_json
from dextera_build.remotes.connect import open_remote
from dextera_build.remotes.spec import Spec
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.protocol import Ended, Report, Said, Task
from dextera_build.workers.staging import Staging
from dextera_build.workers.worker import load

STORE = "DXB_NODE_STORE"
"""Variable that names the folder of a node's store; nodes on one machine may share it, or have one each."""
_TICK_S = 0.5
"""How often a call that says nothing is looked at, so that Ray can interrupt it [s]."""

Word: TypeAlias = dict[str, Any]
"""A report as plain data: exceptions with fields of their own do not survive pickling."""
BEGAN: Word = {"began": True}
"""Sent as soon as Ray has found a place for the call."""


@dataclass(frozen=True)
class Setup:
    """What the workers of one build are told."""

    runner: str
    """`module:function` that carries out a task."""
    shared: Spec
    """The remote for blobs."""
    environment: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    """What must be the same on a node as at the driver: name -> version or digest."""
    compare: str = ""
    """`module:function` from `versions` to what differs here; "" where nothing is to be compared."""


class NodeWorker:
    """Runs calls on a node: its store, and a pool of one process that is kept between calls.

    Args:
        setup: What the build says.
    """

    def __init__(self, setup: Setup) -> None:
        if setup.compare:
            _refuse_difference(load(setup.compare)(setup.versions))
        self._store = Store(folder())
        # Until this process ends, so that no collection takes what was just downloaded.
        self._announced = self._store.running.announced()
        self._announced.__enter__()
        self._staging = Staging(self._store, open_remote(setup.shared))
        self._pool = LocalExecutor(setup.runner, environment=setup.environment, capacity=Capacity(memory_gb=1.0))

    def run(self, task: Task, fresh: bool) -> Iterator[Report]:
        """Run a call; the last report is its end.

        Args:
            task: With the driver's store and project, which this node's stand in for.
            fresh: Nothing that an earlier try kept here may be used.
        """
        self._staging.bring(task.inputs.values())
        if fresh and task.key:
            self._store.keep.drop(task.key)
        # Ray has made the folder with the project's code the current one.
        task = replace(task, store=str(self._store.root), project=os.getcwd(), devices=_devices())
        self._pool.submit(task)
        again = True
        end: Ended | None = None
        try:
            while end is None:
                for report in self._pool.poll(_TICK_S):
                    if isinstance(report, Said):
                        yield report
                    elif again and report.error is not None and report.error.code == MissingBlob.CODE:
                        again = False  # this node's store had lost or damaged something
                        self._staging.bring(task.inputs.values())
                        self._pool.submit(task)
                    else:
                        end = report
        finally:
            if end is None:
                self._pool.stop()
        yield self._delivered(task, end)

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
"""The one of this process; Ray uses a process for one build alone."""


def carry_out(setup: Setup, task: Task, fresh: bool) -> Iterator[Word]:
    """Run a call in this process, and say what becomes of it."""
    yield BEGAN
    began = time.monotonic()
    try:
        if not _here:
            _here.append(NodeWorker(setup))
        for report in _here[0].run(task, fresh):  # Ray sends into what is delegated to, and a `map` takes nothing
            yield spell(report)
    except DxbError as error:
        yield spell(Ended(task.ticket, time.monotonic() - began, b"", error=error))


class ModelActor:
    """An actor for calls of one model, so that its weights stay loaded."""

    def run(self, setup: Setup, task: Task, fresh: bool) -> Iterator[Word]:
        """See `carry_out`."""
        yield from carry_out(setup, task, fresh)


def folder() -> Path:
    """Where this node's store is."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    return Path(os.environ.get(STORE) or home / "dxb" / "node")


def spell(report: Report) -> Word:
    """A report as plain data."""
    if isinstance(report, Said):
        return {"said": [report.kind, dict(report.data)]}
    error = report.error.to_json() if report.error is not None else None
    return {**vars(report), "error": error}


def read(word: Word, ticket: int) -> Report:
    """The report that `spell` spelled."""
    if "said" in word:
        kind, data = word["said"]
        return Said(ticket, kind, data)
    error = from_json(word["error"]) if word["error"] is not None else None
    return Ended(**{**word, "ticket": ticket, "error": error})


def _devices() -> tuple[str, ...]:
    """The GPUs that Ray gave to this worker."""
    return tuple(map(str, sys.modules["ray"].get_gpu_ids())) if "ray" in sys.modules else ()


def _refuse_difference(found: Mapping[str, tuple[str, str]]) -> None:
    if found:
        name = next(iter(found))
        raise MachineError(
            f"a node of the cluster has another `{name}` than the driver",
            code="DXB-E353",
            facts={
                "node": os.uname().nodename,
                **{f"`{name}`": f"driver {there}, node {here}" for name, (there, here) in found.items()},
            },
            hint="install the same versions on every node, and restart Ray there",
        )
