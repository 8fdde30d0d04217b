"""Ray itself, and nothing of it elsewhere: a connection, the nodes, calls and their answers."""

from __future__ import annotations

import os
import re
import signal
import socket
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from dextera_build.errors import MachineError, UsageError, install_extra
from dextera_build.workers.protocol import Report, Task
from dextera_build.workers.ray_worker import Setup, carry_out
from dextera_build.workers.shapes import Amounts, options

_CONNECT_S = 5.0


class RayCluster:
    """A running Ray cluster that this machine is part of.

    Args:
        address: `HOST:PORT` of its head; "" is the one that runs here, or that `RAY_ADDRESS` names.
        code: Folder with the project's code, which becomes the working directory of all calls.

    Raises:
        MachineError: Ray is not installed, or no cluster answers.
        UsageError: The address has no port, or is that of a Ray client server.
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
        # Ray puts its own in place of ours, which lets a build end in order.
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
        # A call is repeated by the scheduler, which says so in the log of the node.
        self._call = ray.remote(num_returns="streaming", max_retries=0)(carry_out)

    def nodes(self) -> list[Amounts]:
        """What each living node has in all."""
        return [node["Resources"] for node in self._ray.nodes() if node["Alive"]]

    def begin(self, setup: Setup, task: Task, reserved: Amounts) -> Any:
        """Queue a call."""
        return self._call.options(**options(reserved)).remote(setup, task)

    def hear(self, calls: Iterable[Any], timeout_s: float) -> Iterator[tuple[Any, Report | Exception]]:
        """What calls say, once there is something; an exception is a call's last word."""
        calls = list(calls)
        some, _ = self._ray.wait(calls, num_returns=1, timeout=timeout_s, fetch_local=False)
        ready, _ = self._ray.wait(calls, num_returns=len(calls), timeout=0, fetch_local=False) if some else ([], [])
        for call in ready:
            try:
                yield call, self._ray.get(next(call))
            except Exception as error:  # Ray's own, for all that can happen to a call
                yield call, error

    def cancel(self, call: Any) -> None:
        """Ask a task to end."""
        with suppress(Exception):  # it has ended
            self._ray.cancel(call)

    def close(self) -> None:
        """Disconnect; Ray ends what is left."""
        self._ray.shutdown()


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
            hint=install_extra("ray"),
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
    socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
