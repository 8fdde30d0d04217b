"""Ray itself, and nothing of it elsewhere: a connection, the nodes, actors and their answers."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

from dextera_build.engine.executors.placement import Shape
from dextera_build.engine.executors.ray_worker import RayWorker, Setup, Word
from dextera_build.engine.executors.shapes import options
from dextera_build.engine.tasks import Task
from dextera_build.errors import MachineError, UsageError

_CONNECT_S = 5.0

Heard: TypeAlias = Callable[[list[Word] | Exception], None]
"""Takes what a worker says, or why it says nothing any more; called in any thread."""


class Hand(Protocol):
    """A worker on the cluster, as the executor sees it."""

    def run(self, task: Task, fresh: bool, heard: Heard) -> None:
        """Begin a call."""
        ...

    def more(self, heard: Heard) -> None:
        """Hear more of a call that has not ended."""
        ...

    def stop(self) -> None:
        """Ask it to end what runs."""
        ...

    def kill(self) -> None:
        """End it, and what it reserves is free."""
        ...


class Cluster(Protocol):
    """What workers are hired from."""

    address: str
    """Of this machine, as nodes reach it."""

    def nodes(self) -> Mapping[str, Mapping[str, float]]:
        """Living node -> resource -> how much it has."""
        ...

    def hire(self, setup: Setup, shape: Shape, node: str) -> Hand:
        """A new worker, on `node` if there is room."""
        ...

    def close(self) -> None:
        """Let the cluster go."""
        ...


class RayCluster:
    """A running Ray cluster that this machine is part of.

    Args:
        address: `HOST:PORT` of its head; "" is the one that runs here, or that `RAY_ADDRESS` names.

    Raises:
        MachineError: Ray is not installed, or no cluster answers.
        UsageError: The address has no port, or is that of a Ray client server.
    """

    def __init__(self, address: str = "") -> None:
        if "://" in address:
            raise UsageError(
                f"`{address}` is not the address of a Ray cluster",
                code="DXB-U178",
                facts={"form": "HOST:PORT of the head, from a machine that is part of the cluster"},
                hint=f"ray start --address={address.partition('://')[2]} --num-cpus=0",
            )
        if address and ":" not in address:
            raise UsageError(
                f"`{address}` is not the address of a Ray cluster",
                code="DXB-U178",
                facts={"form": "HOST:PORT of the head"},
                hint=f"--executor ray:{address}:6379",
            )
        ray = _imported()
        known = address or os.environ.get("RAY_ADDRESS") or _last()
        if ":" in known:
            _reach(known)
        # Ray puts its own in place of ours, which lets a build end in order.
        ours = signal.getsignal(signal.SIGTERM)
        try:
            ray.init(address=address or "auto", log_to_driver=False, configure_logging=False, logging_level="ERROR")
        except Exception as error:  # Ray's, gRPC's and the system's own
            raise _no_cluster(address, error) from None
        finally:
            with suppress(ValueError):  # not the main thread
                signal.signal(signal.SIGTERM, ours)
        self._ray = ray
        self._actor = ray.remote(concurrency_groups={"stop": 1})(_with_groups(ray))
        self.address = str(ray.util.get_node_ip_address())

    def nodes(self) -> Mapping[str, Mapping[str, float]]:
        """Living node -> resource -> how much it has."""
        return {node["NodeID"]: node["Resources"] for node in self._ray.nodes() if node["Alive"]}

    def hire(self, setup: Setup, shape: Shape, node: str) -> Hand:
        """A new worker, on `node` if there is room."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        place = NodeAffinitySchedulingStrategy(node_id=node, soft=True)
        actor = self._actor.options(**options(shape), max_restarts=0, scheduling_strategy=place)
        return _RayHand(self._ray, actor.remote(setup))

    def close(self) -> None:
        """Disconnect; Ray ends the workers that are left."""
        self._ray.shutdown()


@dataclass(frozen=True)
class _RayHand:
    ray: Any
    actor: Any

    def run(self, task: Task, fresh: bool, heard: Heard) -> None:
        _listen(self.actor.run.remote(task, fresh), heard)

    def more(self, heard: Heard) -> None:
        _listen(self.actor.more.remote(), heard)

    def stop(self) -> None:
        self.actor.stop.remote()

    def kill(self) -> None:
        with suppress(Exception):  # it is dead
            self.ray.kill(self.actor, no_restart=True)


def _listen(reference: Any, heard: Heard) -> None:
    def done(future: Any) -> None:
        error = future.exception()
        heard(future.result() if error is None else error)

    reference.future().add_done_callback(done)


def _with_groups(ray: Any) -> type:
    """`RayWorker` with `stop` beside what runs."""

    class Worker(RayWorker):
        stop = ray.method(concurrency_group="stop")(RayWorker.stop)

    return Worker


def _imported() -> Any:
    # Its notice of what it reports to its makers has no place in a build's output.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError as error:
        raise MachineError(
            "`--executor ray` needs the package `ray`, which is not installed",
            code="DXB-E350",
            facts={"missing": error.name or str(error)},
            hint="pip install 'dextera-build[ray]'",
        ) from None
    return ray


def _last() -> str:
    """The address of the cluster that was started here last, which may be gone; "" where Ray knows of none."""
    with suppress(Exception):  # this is Ray's own; without it `ray.init` waits for minutes, and is right in the end
        from ray._private.services import canonicalize_bootstrap_address

        return canonicalize_bootstrap_address("auto") or ""
    return ""


def _reach(address: str) -> None:
    """Raise where nothing answers at `HOST:PORT`: Ray would end this process."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
    except (OSError, ValueError, OverflowError) as error:
        raise _no_cluster(address, error) from None


def _no_cluster(address: str, error: Exception) -> MachineError:
    return MachineError(
        f"no Ray cluster answers at `{address}`" if address else "no Ray cluster runs here",
        code="DXB-E351",
        facts={"because": _first_line(error)},
        hint="`ray start --head` starts one, `ray status` shows it",
    )


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
