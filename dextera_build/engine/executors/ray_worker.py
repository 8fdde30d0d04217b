"""The worker on a node of a Ray cluster: has a store there, fetches what a call reads, and gives back what it made.

An actor of this class is one place for one call at a time. The call itself runs in a process of the local pool, so what
it prints, what it uses and how it dies is told as it is on one machine. Nothing here imports Ray but `devices`.
"""

from __future__ import annotations

import importlib
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from dextera_build.engine.capacity import Capacity
from dextera_build.engine.executors.local import LocalExecutor
from dextera_build.engine.executors.staging import Staging
from dextera_build.engine.tasks import Ended, Report, Said, Task
from dextera_build.errors import DxbError, MachineError, from_json
from dextera_build.store import files
from dextera_build.store.cas import MissingBlob
from dextera_build.store.remotes.connect import open_remote
from dextera_build.store.remotes.spec import Spec
from dextera_build.store.store import Store

STORE = "DXB_NODE_STORE"
"""Variable that names the folder of a node's store; nodes on one machine may share it, or have one each."""
_GRACE_S = 1.0
_PATIENCE_S = 30.0
"""How long the driver's store may take to answer [s]."""
_OLD_CODE_S = 7 * 86400.0

Word: TypeAlias = dict[str, Any]
"""A report as plain data; exceptions with fields of their own do not survive pickling."""


@dataclass(frozen=True)
class Setup:
    """What all workers of one build are told."""

    runner: str
    """`module:function` that carries out a task."""
    driver: str
    """URL of the driver's store, with its password."""
    environment: Mapping[str, str] = field(default_factory=dict)
    code: str = ""
    """Digest of a table of the project's source files; "" where the project's folder is the same on every node."""
    stand: Mapping[str, str] = field(default_factory=dict)
    """What must be the same on a node as at the driver: name -> version or digest."""
    compare: str = ""
    """`module:function` from `stand` to what differs here; "" where nothing is to be compared."""


class RayWorker:
    """One place for calls.

    Args:
        setup: What the build says.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._store = Store(folder())
        # Until this process ends, so that no collection takes what was just fetched.
        self._announced = self._store.running.announced()
        self._announced.__enter__()
        spec = Spec("driver", setup.driver, "rw", _PATIENCE_S)
        # The password is made for one build, and the network is the cluster's own.
        self._staging = Staging(self._store, open_remote(spec, trusted_network=True))
        self._devices = devices()
        self._pool: LocalExecutor | None = None
        self._project = ""
        self._task: Task | None = None
        self._again = False

    def run(self, task: Task, fresh: bool) -> list[Word]:
        """Begin a call, and return the first that there is to say of it; if it has not ended, `more` says more.

        Args:
            task: With the driver's store and project, which the node's stand in for.
            fresh: Nothing that an earlier try kept here may be used.
        """
        began = time.monotonic()
        try:
            pool = self._ready(task)
            self._staging.pull(task.inputs.values())
            if fresh and task.key:
                self._store.keep.drop(task.key)
        except DxbError as error:
            return [spell(Ended(task.ticket, time.monotonic() - began, b"", error=error))]
        self._task = replace(task, store=str(self._store.root), project=self._project, devices=self._devices)
        self._again = True
        pool.submit(self._task)
        return self.more()

    def more(self) -> list[Word]:
        """Wait until there is something to say."""
        assert self._pool is not None
        said: list[Report] = []
        while not said:
            said = [mine for report in self._pool.poll(None) if (mine := self._finish(report)) is not None]
        return [spell(report) for report in said]

    def stop(self) -> None:
        """End the call that runs; called beside `run` and `more`."""
        pids = self._pool.pids() if self._pool is not None else []
        for number, rest_s in ((signal.SIGTERM, _GRACE_S), (signal.SIGKILL, 0.0)):
            for pid in pids:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(pid, number)
            time.sleep(rest_s)

    def _ready(self, task: Task) -> LocalExecutor:
        """The pool of one process, once the node has the project's code and the same packages."""
        if self._pool is None:
            self._project = self._code() or task.project
            if self._setup.compare:
                _refuse_difference(_named(self._setup.compare)(self._setup.stand, self._project))
            self._pool = LocalExecutor(
                self._setup.runner, environment=self._setup.environment, capacity=Capacity(memory_gb=1.0)
            )
        return self._pool

    def _code(self) -> str:
        """The folder with the project's code."""
        digest = self._setup.code
        if not digest:
            return ""
        home = self._store.local / "code"
        place = home / digest
        if not place.is_dir():
            self._staging.bring([digest])
            table: dict[str, str] = json.loads(self._store.blobs.get(digest))
            self._staging.bring(table.values())
            _sweep(home)
            aside = home / f"{files.TEMPORARY}-{os.getpid()}-{time.monotonic_ns()}"
            for name, blob in table.items():
                target = aside / name
                target.parent.mkdir(parents=True, exist_ok=True)
                self._store.reader.place(blob, target)
            with suppress(OSError):  # another worker of this node was faster
                aside.rename(place)
        os.utime(place)
        # As the project's folder is on the driver's path when its own packages are found there.
        sys.path.append(str(place))
        return str(place)

    def _finish(self, report: Report) -> Report | None:
        if isinstance(report, Said):
            return report
        if isinstance(report.error, MissingBlob) or (report.error and report.error.code == MissingBlob.CODE):
            return self._fetch_again(report)
        if report.reply is None:
            return report
        try:
            self._staging.push(report.reply)
        except DxbError as error:
            return replace(report, reply=None, error=error)
        # What was stored a moment ago was stored here, and the driver may have had it before.
        report = replace(report, reply={name: told for name, told in report.reply.items() if name != "sizes"})
        if self._task is not None and self._task.key:
            self._store.keep.drop(self._task.key)
        return report

    def _fetch_again(self, report: Ended) -> Report | None:
        """The node's store had lost or damaged something: fetch it and run once more."""
        assert self._task is not None
        assert self._pool is not None
        if not self._again:
            return report
        self._again = False
        try:
            self._staging.pull(self._task.inputs.values())
        except DxbError as error:
            return replace(report, error=error)
        self._pool.submit(self._task)
        return None


def folder() -> Path:
    """Where this node's store is."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    return Path(os.environ.get(STORE) or home / "dxb" / "node")


def devices() -> tuple[str, ...]:
    """The GPUs that Ray gave to this actor."""
    if "ray" not in sys.modules:
        return ()
    ray = sys.modules["ray"]
    return tuple(str(device) for device in ray.get_gpu_ids())


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
            hint="install the same versions on every node, and start Ray anew there",
        )


def _named(text: str) -> Callable[..., Mapping[str, tuple[str, str]]]:
    module, _, name = text.partition(":")
    found: Callable[..., Mapping[str, tuple[str, str]]] = getattr(importlib.import_module(module), name)
    return found


def _sweep(home: Path) -> None:
    """Remove code that no build asked for lately, and what kills left."""
    home.mkdir(parents=True, exist_ok=True)
    for old in home.iterdir():
        with suppress(OSError):
            if old.stat().st_mtime < time.time() - _OLD_CODE_S:
                shutil.rmtree(old, ignore_errors=True)
