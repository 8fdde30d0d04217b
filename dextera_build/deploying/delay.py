"""How long a message takes to a robot and back, by the network alone.

Stamps show only by how much a message is later than others: the offset of two clocks and a delay cannot be told apart.
A connection that is refused is an answer, too.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence

PORTS = (7400, 22, 80, 443)
"""Ports of TCP that are asked in turn: the first is that of DDS, whose UDP ports are open, and seldom that of TCP."""
WAIT_S = 0.5
"""Longest wait for an answer [s]."""
TIMES = 5
"""Number of answers, of which the median is taken."""


def round_trip_s(host: str, ports: Sequence[int] = PORTS) -> float | None:
    """Time to a machine and back [s]; None if none of the ports answers."""
    try:
        address = socket.gethostbyname(host)
    except OSError:
        return None
    for port in ports:
        if answered_s(address, port) is not None:
            times = [answered_s(address, port) or WAIT_S for _ in range(TIMES)]
            return sorted(times)[TIMES // 2]
    return None


def longest_s(hosts: Sequence[str]) -> float | None:
    """Longest time to several machines and back [s]; None if one does not answer."""
    times = [round_trip_s(host) for host in hosts]
    known = [each for each in times if each is not None]
    return max(known) if len(known) == len(times) else None


def answered_s(address: str, port: int) -> float | None:
    """Time until a connection is made or refused [s]; None if neither happens in time."""
    begun = time.perf_counter()
    try:
        socket.create_connection((address, port), WAIT_S).close()
    except ConnectionRefusedError:
        pass
    except OSError:
        return None
    return time.perf_counter() - begun
