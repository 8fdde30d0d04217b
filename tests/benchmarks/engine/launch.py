"""Runs one command and prints, as JSON, what it cost: `launch.py LIMIT LOG COMMAND...`.

A program of its own because a process inherits, as its greatest memory, that of the process that started it.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time


def main(limit: float, log: str, command: list[str]) -> None:
    """Run `command` in a session of its own, killed after `limit` seconds."""
    actions = [
        (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
        (os.POSIX_SPAWN_OPEN, 1, log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644),
        (os.POSIX_SPAWN_DUP2, 1, 2),
    ]
    late: list[bool] = []
    began = time.perf_counter()
    pid = os.posix_spawnp(command[0], command, os.environ, file_actions=actions, setsid=True)

    def stop(*_: object) -> None:
        late.append(True)
        os.killpg(pid, signal.SIGKILL)

    for reason in (signal.SIGALRM, signal.SIGTERM, signal.SIGINT):
        signal.signal(reason, stop)
    signal.setitimer(signal.ITIMER_REAL, limit)
    _, status, used = os.wait4(pid, 0)
    seconds = time.perf_counter() - began
    signal.setitimer(signal.ITIMER_REAL, 0)
    code = os.waitstatus_to_exitcode(status)
    cost = {"seconds": seconds, "cpu": used.ru_utime + used.ru_stime, "rss_mib": used.ru_maxrss / 1024}
    print(json.dumps({"code": code, "late": bool(late), **cost}))


if __name__ == "__main__":
    main(float(sys.argv[1]), sys.argv[2], sys.argv[3:])
