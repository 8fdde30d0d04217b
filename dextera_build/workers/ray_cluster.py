"""The only module that uses Ray: the connection, resources of nodes and calls, calls and their answers."""

from __future__ import annotations

import math
import os
import re
import signal
import socket
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias

from dextera_build.errors import MachineError, UsageError, install_extra
from dextera_build.workers.capacity import MEASURED, Capacity, Gpu, Needs
from dextera_build.workers.protocol import Report, Task
from dextera_build.workers.ray_worker import Holder, Setup, carry_out

Amounts: TypeAlias = Mapping[str, float]
"""Resources of a node or a call by Ray's names: `CPU`, `GPU`, `memory` [bytes], or names that nodes declare."""

_CONNECT_S = 5.0
_GIB = 2**30
_FINEST = 100
"""Fractions of a GPU are counted in hundredths."""


class RayCluster:
    """A running Ray cluster that this machine is part of.

    Args:
        address: `HOST:PORT` of its head; "" for the cluster running here or named by `RAY_ADDRESS`.
        code: Folder with the project's code, the working directory of all calls.

    Raises:
        MachineError: Ray is not installed, or no cluster answers.
        UsageError: The address has no port, or belongs to a Ray client server.
    """

    def __init__(self, address: str, code: Path) -> None:
        if address and not re.fullmatch(r"[^/]+:\w+", address):
            raise UsageError(
                f"`{address}` is not the address of a Ray cluster",
                code="DXB-U178",
                facts={"form": "HOST:PORT of the head, from a machine that is part of the cluster"},
                hint=f"--executor ray:{address.rpartition('/')[2].partition(':')[0]}:6379",
            )
        self._ray = ray = _imported()
        # Ray replaces our SIGTERM handler, which is needed to end a build cleanly.
        ours = signal.getsignal(signal.SIGTERM)
        known = address or os.environ.get("RAY_ADDRESS") or _last()
        try:
            if ":" in known:
                _reach(known)
            ray.init(
                address=address or "auto",
                runtime_env={"working_dir": str(code)},
                log_to_driver=False,
                configure_logging=False,
                logging_level="ERROR",
            )
        except Exception as error:  # Ray's, gRPC's and the system's own
            raise MachineError(
                f"no Ray cluster answers at `{known}`" if known else "no Ray cluster runs here",
                code="DXB-E351",
                facts={"because": (str(error).strip() or type(error).__name__).splitlines()[0]},
                hint="`ray start --head` starts one, `ray status` shows it",
            ) from None
        finally:
            with suppress(ValueError):  # not the main thread
                signal.signal(signal.SIGTERM, ours)
        # No retries by Ray: the scheduler retries calls and logs it.
        self._call = ray.remote(num_returns="streaming", max_retries=0)(carry_out)
        self._holder = ray.remote(max_restarts=0, max_task_retries=0)(Holder)

    def nodes(self) -> list[Amounts]:
        """Total resources of each live node."""
        return [node["Resources"] for node in self._ray.nodes() if node["Alive"]]

    def begin(self, setup: Setup, task: Task, reserved: Amounts) -> Any:
        """Queue a call."""
        return self._call.options(**_options(reserved)).remote(setup, task)

    def hold(self, reserved: Amounts) -> Any:
        """Start an actor, which keeps its GPU and memory; cores are counted by the driver, as it is mostly idle."""
        return self._holder.options(**_options({**reserved, "CPU": 0.0})).remote()

    def ask(self, actor: Any, setup: Setup, task: Task) -> Any:
        """Queue a call on an actor."""
        return actor.carry_out.options(num_returns="streaming").remote(setup, task)

    def end(self, actor: Any) -> None:
        """End an actor and its processes."""
        with suppress(Exception):  # it has ended
            self._ray.kill(actor)

    def hear(self, calls: Iterable[Any], timeout_s: float) -> Iterator[tuple[Any, Report | Exception]]:
        """Yield messages of calls, waiting for the first; an exception ends its call."""
        calls = list(calls)
        some, _ = self._ray.wait(calls, num_returns=1, timeout=timeout_s, fetch_local=False)
        ready, _ = self._ray.wait(calls, num_returns=len(calls), timeout=0, fetch_local=False) if some else ([], [])
        for call in ready:
            try:
                yield call, self._ray.get(next(call))
            except Exception as error:  # Ray's own, for any failure of a call
                yield call, error

    def cancel(self, call: Any) -> None:
        """Ask a call to end."""
        with suppress(Exception):  # it has ended
            self._ray.cancel(call)

    def close(self) -> None:
        """Disconnect; Ray ends the remaining calls."""
        self._ray.shutdown()


def _options(reserved: Amounts) -> dict[str, object]:
    amounts = dict(reserved)
    cpus, gpus, memory = (amounts.pop(name, 0.0) for name in ("CPU", "GPU", "memory"))
    return {"num_cpus": cpus, "num_gpus": gpus, "memory": int(memory) or None, "resources": amounts or None}


def capacity(nodes: Collection[Amounts], said: Mapping[str, float]) -> Capacity:
    """The capacity of all nodes together.

    Args:
        nodes: Resources of each node.
        said: Configured amounts: `cpu` limits the cores used of the cluster, `gpu_memory` is the memory of each GPU
            [GiB], named resources are added to those that nodes declare.
    """
    totals = defaultdict[str, float](float)
    for name, amount in (item for node in nodes for item in node.items()):
        totals[name] += amount
    cpus = int(min(totals["CPU"], said.get("cpu") or math.inf))
    gpus = tuple(Gpu(str(number), said.get("gpu_memory", 0.0)) for number in range(int(totals["GPU"])))
    # Ray itself adds resources for addresses and kinds of devices.
    own = [name for name in totals if ":" in name and not name.startswith(("node:", "accelerator_type:"))]
    named = {name: totals[name] for name in own} | {n: amount for n, amount in said.items() if n not in MEASURED}
    return Capacity(max(cpus, 1), max(totals["memory"] / _GIB, 0.25), gpus, named)


def shape(needs: Needs, nodes: Collection[Amounts], gpu_memory_gb: float = 0.0) -> Amounts:
    """The resources that a call with `needs` reserves; excess cores or memory are clamped to those of a node.

    Args:
        needs: Declared needs of the rule.
        nodes: Resources of each node.
        gpu_memory_gb: Memory of one GPU [GiB]; if 0 (unknown), a call that needs part of a GPU reserves a whole one.

    Raises:
        MachineError: There is no node, or none has the GPUs and the named resources.
    """
    if not nodes:
        raise MachineError(
            "no machine of the cluster is left",
            code="DXB-E354",
            hint="`ray status` lists nodes; finished results are kept, build again",
        )
    # Resources named only in the configuration are counted by the driver; Ray does not know them.
    counted = {name for node in nodes for name in node}
    fixed = {name: amount for name, amount in needs.named if name in counted}
    if needs.gpus:
        fixed["GPU"] = float(needs.gpus)
    elif needs.gpu_gb:
        part = needs.gpu_gb / gpu_memory_gb if gpu_memory_gb else 1.0
        fixed["GPU"] = min(math.ceil(part * _FINEST) / _FINEST, 1.0)
    wish = {"CPU": float(max(needs.cpus, 1)), "memory": float(math.ceil(needs.memory_gb * _GIB))}
    given = [{n: min(wish[n], node.get(n, 0.0)) for n in wish} for node in nodes if fits(fixed, node)]
    if not given:
        wanted = ", ".join(f"{amount:g} of `{name}`" for name, amount in fixed.items())
        most = {name: max(node.get(name, 0.0) for node in nodes) for name in fixed}
        raise MachineError(
            f"it needs {wanted} on one node, which no node of the cluster has",
            code="DXB-E352",
            facts={f"most `{name}` of a node": f"{amount:g}" for name, amount in most.items()},
            hint="choose another backend, or add a node that has all of it: `ray start --address=HOST:PORT`",
        )
    best = max(given, key=lambda amounts: (amounts["CPU"], amounts["memory"]))
    return {name: amount for name, amount in (best | fixed).items() if amount}


def fits(wanted: Amounts, node: Amounts) -> bool:
    """Whether the total resources of a node are sufficient."""
    return all(node.get(name, 0.0) >= amount for name, amount in wanted.items())


def _imported() -> Any:
    # Keeps Ray's usage-statistics notice out of the build's output.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError as error:
        raise MachineError(
            "`--executor ray` needs the package `ray`, which is not installed",
            code="DXB-E350",
            facts={"missing": error.name or str(error)},
            hint=install_extra("ray"),
        ) from None
    return ray


def _last() -> str:
    """Address of the cluster last started here, which may be gone; "" if Ray knows none."""
    with suppress(Exception):  # private API; without it `ray.init` still works, but may wait for minutes
        from ray._private.services import canonicalize_bootstrap_address

        return canonicalize_bootstrap_address("auto") or ""
    return ""


def _reach(address: str) -> None:
    """Raise if nothing answers at `HOST:PORT`; Ray would end this process instead."""
    host, _, port = address.rpartition(":")
    socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
