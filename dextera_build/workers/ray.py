"""Runs nodes on a Ray cluster: the scheduler decides which may start, Ray decides where.

A call is a Ray task that reserves the resources of its rule, or a call of an actor that keeps its model on a GPU
(`workers/ray_models.py`). A call whose worker is lost fails, and the scheduler retries it (`workers/retries.py`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, Self

from dextera_build.errors import DxbError, MachineError
from dextera_build.remotes.spec import open_remote
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.protocol import Ended, Report, Said, Task
from dextera_build.workers.ray_cluster import Amounts, RayCluster, capacity, fits, shape
from dextera_build.workers.ray_models import Models
from dextera_build.workers.ray_worker import Setup
from dextera_build.workers.staging import Staging

_LOOK_S = 2.0
"""Interval at which the cluster is queried for its nodes [s]."""
_GRACE_S = 1.5


class RayExecutor:
    """Calls on a cluster; use it as a context manager.

    Args:
        cluster: Runs the calls; closed here.
        store: The driver's store.
        setup: Settings for workers.
        said: Configured amounts, which override those of the cluster; see `ray_cluster.capacity`.
        discovering: Rules that discover project files, which other machines do not have.
    """

    def __init__(
        self,
        cluster: RayCluster,
        store: Store,
        setup: Setup,
        *,
        said: Mapping[str, float] | None = None,
        discovering: Collection[str] = (),
    ) -> None:
        self._cluster, self._setup = cluster, setup
        self._said, self._discovering = said or {}, discovering
        self._nodes = cluster.nodes()
        self._looked = time.monotonic()
        self.capacity: Capacity = capacity(self._nodes, self._said)
        self._models = Models(cluster)
        self._staging = Staging(store, open_remote(setup.shared))
        self._calls: dict[Any, tuple[Task, Amounts]] = {}
        """By Ray's handle of the call."""
        self._reports: list[Report] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()
        self._cluster.close()

    def submit(self, task: Task) -> None:
        """Upload the inputs of the call, and queue it."""
        try:
            if task.rule in self._discovering:
                raise MachineError(
                    f"`{task.rule}` reads files of the project by itself, which other machines do not have",
                    code="DXB-E370",
                    hint="build its nodes with `--executor local` first; the cluster then takes their results",
                )
            reserved = shape(task.needs, self._nodes, self._said.get("gpu_memory", 0.0))
            self._staging.send(task.inputs.values())
            self._models.make_room(task, reserved, [other for _, other in self._calls.values()], self._nodes)
            # An idle actor would keep named resources, for instance a licence, from other calls.
            runs = self._models if task.weights and "GPU" in reserved and not task.needs.named else self._cluster
            self._calls[runs.begin(self._setup, task, reserved)] = task, reserved
        except DxbError as error:
            self._reports.append(Ended(task.ticket, 0.0, b"", error=error))

    def poll(self, timeout_s: float | None) -> list[Report]:
        """New reports of calls."""
        end = math.inf if timeout_s is None else time.monotonic() + timeout_s
        while self._calls and not self._reports:
            left = max(0.0, end - time.monotonic())
            for call, said in self._cluster.hear(self._calls, min(left, _LOOK_S)):
                self._hear(call, said)
            if time.monotonic() >= self._looked + _LOOK_S:
                self._look()
            if not left:
                break
        reports, self._reports = self._reports, []
        return reports

    def stop(self) -> None:
        """End all calls and their processes."""
        for call in self._calls:
            self._cluster.cancel(call)
        self._models.stop()
        deadline = time.monotonic() + _GRACE_S
        while self._calls and (left := deadline - time.monotonic()) > 0:
            for call, said in self._cluster.hear(self._calls, left):
                if isinstance(said, Exception):
                    del self._calls[call]
        self._calls.clear()
        self._reports.clear()

    def _hear(self, call: Any, said: Report | Exception) -> None:
        if not isinstance(said, Said):
            self._models.ended(call, lost=isinstance(said, Exception))
        if isinstance(said, Exception):
            said = Ended(self._calls[call][0].ticket, 0.0, b"", error=_lost(said))
        if isinstance(said, Ended):
            del self._calls[call]
            if said.reply is not None:
                try:
                    self._staging.bring_made(said.reply)
                except DxbError as error:
                    said = replace(said, reply=None, error=error)
        self._reports.append(said)

    def _look(self) -> None:
        """End actors that are idle for long, and fail calls that no remaining machine can run."""
        self._models.end_stale()
        self._nodes, self._looked = self._cluster.nodes(), time.monotonic()
        for call, (_, reserved) in list(self._calls.items()):
            if not any(fits(reserved, node) for node in self._nodes):
                self._cluster.cancel(call)
                self._hear(call, ConnectionError("no machine is left that has room for it"))


def _lost(error: Exception) -> MachineError:
    error = getattr(error, "cause", None) or error  # the text of the wrapper begins with its origin
    reason = (str(error).strip() or type(error).__name__).splitlines()[0]
    return MachineError(
        "its worker was lost",
        code="DXB-E354",
        facts={"ray says": reason},
        hint="`ray status` shows which nodes are left; build again",
    )
