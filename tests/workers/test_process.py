"""A worker has nothing of other workers and of the program that builds, and its death is seen."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from dextera_build.store import locks
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.protocol import Ended, Report, Task
from tests.engine.test_interrupt import gone

HERE = "tests.workers.test_process:look"
ROOT = Path(__file__).parents[2]


def look(task: Mapping[str, Any], emit: Callable[[str, Any], None]) -> dict[str, Any]:
    """What a task sees of the process that it runs in."""
    if task["options"] == {"do": "leave a daemon"}:
        if not os.fork():
            os.setsid()
            if not os.fork():
                time.sleep(60.0)
            os._exit(0)
        os.wait()
        emit("log", {"text": Path(f"/proc/self/task/{os.getpid()}/children").read_text().strip()})
        time.sleep(60.0)
    if task["options"] == {"do": "leave a child"}:
        if not os.fork():
            time.sleep(60.0)
        emit("log", {"text": Path(f"/proc/self/task/{os.getpid()}/children").read_text().strip()})
        os.kill(os.getpid(), signal.SIGKILL)
    opened = {int(name) for name in os.listdir("/proc/self/fd")} - {0, 1, 2}
    return {
        "files": sorted(_kind(descriptor) for descriptor in opened if os.path.exists(f"/proc/self/fd/{descriptor}")),
        "inherited": [number for number in opened if _is_inheritable(number)],
        "stdin": os.readlink("/proc/self/fd/0"),
        "folder": os.getcwd(),
        "path": sys.path,
        "main": getattr(sys.modules["__main__"], "__file__", ""),
        "signals": [getattr(found, "__name__", found) for found in map(signal.getsignal, (2, 15, 17))],
        "leads its group": os.getpgid(0) == os.getpid(),
        "leads its session": os.getsid(0) == os.getpid(),
        "locks": [len(locks._open), len(locks._held)],
        "devices": os.environ["CUDA_VISIBLE_DEVICES"],
        "threads": threading.active_count(),
        "pid": os.getpid(),
    }


def _kind(descriptor: int) -> str:
    return os.readlink(f"/proc/self/fd/{descriptor}").partition("[")[0].replace(str(os.getpid()), "self")


def _is_inheritable(descriptor: int) -> bool:
    try:
        return os.get_inheritable(descriptor)
    except OSError:
        return False


def task(ticket: int, do: str = "look", devices: tuple[str, ...] = ()) -> Task:
    return Task(ticket, "tiny.rule", None, {"do": do}, {}, "/nowhere", "", "", devices=devices)


def reported(pool: LocalExecutor, count: int) -> list[Report]:
    """The next reports of a pool."""
    reports: list[Report] = []
    deadline = time.monotonic() + 60
    while len(reports) < count and time.monotonic() < deadline:
        reports += pool.poll(1.0)
    return reports


def seen(pool: LocalExecutor, *tasks: Task) -> list[dict[str, Any]]:
    """What tasks see that run at once, in their order."""
    for each in tasks:
        pool.submit(each)
    ended = [report for report in reported(pool, len(tasks)) if isinstance(report, Ended)]
    return [dict(report.reply or {}) for report in sorted(ended, key=lambda report: report.ticket)]


_SCRIPT = """
import json, os, sys, threading
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from tests.workers.test_process import HERE, seen, task
with open(sys.argv[1], "a") as ran:
    ran.write("once\\n")
sys.path.append("/appended by the script")
secret = os.open(sys.argv[1], os.O_RDONLY)
os.set_inheritable(secret, True)
threading.Thread(target=threading.Event().wait, daemon=True).start()
with LocalExecutor(HERE, Capacity(1, 4.0)) as pool:
    print(json.dumps(seen(pool, task(0))))
"""


@pytest.mark.medium
def test_a_worker_sees_nothing_of_the_script_that_builds(tmp_path: Path) -> None:
    """The script has no `if __name__ == "__main__"`, and files and threads of its own."""
    (tmp_path / "script.py").write_text(_SCRIPT)
    script = subprocess.run(
        [sys.executable, tmp_path / "script.py", tmp_path / "ran"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    (found,) = json.loads(script.stdout)
    assert (tmp_path / "ran").read_text() == "once\n"
    assert found["main"].endswith("workers/worker.py")
    assert str(tmp_path / "ran") not in found["files"]
    assert found["inherited"] == []
    assert found["stdin"] == os.devnull
    assert found["threads"] == 1
    assert found["leads its group"]
    assert found["leads its session"]
    assert found["locks"] == [0, 0]
    assert found["path"][0] == found["folder"] == str(tmp_path)
    assert found["path"][-1] == "/appended by the script"
    assert found["signals"] == [1, "_leave", 0]


def test_workers_share_nothing() -> None:
    with LocalExecutor(HERE, Capacity(2, 4.0)) as pool:
        first, second = seen(pool, task(0, devices=("0",)), task(1, devices=("1",)))
    assert first["pid"] != second["pid"]
    assert (first["devices"], second["devices"]) == ("0", "1")


def test_a_worker_is_seen_to_die_though_a_child_of_it_holds_its_socket() -> None:
    with LocalExecutor(HERE, Capacity(1, 4.0)) as pool:
        pool.submit(task(0, "leave a child"))
        said, ended = reported(pool, 2)
        assert isinstance(ended, Ended)
        assert ended.error is not None
        assert ended.error.message == "worker died (signal 9)"
        assert gone([int(said.data["text"])])  # type: ignore[union-attr]


@pytest.mark.parametrize("is_dead", [False, True], ids=["a worker that lives", "a dead one"])
def test_a_daemon_in_a_session_of_its_own_ends_with_its_worker(is_dead: bool) -> None:
    with LocalExecutor(HERE, Capacity(1, 4.0)) as pool:
        pool.submit(task(0, "leave a daemon"))
        (said,) = reported(pool, 1)
        if is_dead:
            os.kill(pool.pids()[0], signal.SIGKILL)
            os.waitid(os.P_PID, pool.pids()[0], os.WEXITED | os.WNOWAIT)
    assert gone([int(said.data["text"])])  # type: ignore[union-attr]


def test_workers_start_in_the_folder_of_their_pool(tmp_path: Path) -> None:
    with LocalExecutor(HERE, Capacity(1, 4.0), folder=tmp_path) as pool:
        (found,) = seen(pool, task(0))
    assert found["folder"] == str(tmp_path)
