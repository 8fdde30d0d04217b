"""What makes workers: they have nothing of each other and of who builds, and end with it."""

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

from dextera_build.engine.execute import build
from dextera_build.engine.executors.local import LocalExecutor
from dextera_build.engine.executors.nursery import Nursery
from dextera_build.engine.executors.process import Process
from dextera_build.engine.tasks import Task
from dextera_build.errors import MachineError
from dextera_build.store import files, locks
from dextera_build.store.store import Store
from tests.engine.test_interrupt import gone
from tests.engine.tiny import RUNNER, Record, call, graph

HERE = "tests.engine.test_nursery:look"
if os.environ.get("NURSERY_THREADS"):
    threading.Thread(target=threading.Event().wait, daemon=True).start()


def look(task: Mapping[str, Any], emit: Callable[[str, Any], None]) -> dict[str, Any]:
    """What a task sees of the process that it runs in."""
    if task["options"] == {"do": "leave a child"}:
        if not os.fork():
            time.sleep(60.0)
        emit("log", {"text": Path(f"/proc/self/task/{os.getpid()}/children").read_text().strip()})
        os.kill(os.getpid(), signal.SIGKILL)
    if task["options"] == {"do": "sleep"}:
        emit("log", {"text": "began"})
        time.sleep(60.0)
    opened = {int(name) for name in os.listdir("/proc/self/fd")} - {0, 1, 2}
    seen = {
        "files": sorted(_kind(descriptor) for descriptor in opened if os.path.exists(f"/proc/self/fd/{descriptor}")),
        "inherited": [number for number in opened if number < 3 or _is_inheritable(number)],
        "stdin": os.readlink("/proc/self/fd/0"),
        "folder": os.getcwd(),
        "path": sys.path,
        "main": getattr(sys.modules["__main__"], "__file__", ""),
        "signals": [getattr(found, "__name__", found) for found in map(signal.getsignal, (2, 15, 17))],
        "leads its group": os.getpgid(0) == os.getpid(),
        "session": os.getsid(0) in (os.getpid(), os.getppid()),
        "locks": [len(locks._open), len(locks._held)],
        "CUDA_VISIBLE_DEVICES": os.environ["CUDA_VISIBLE_DEVICES"],
        "NURSERY": os.environ.get("NURSERY"),
    }
    return {
        "output": json.dumps(seen),
        "pids": (os.getpid(), os.getppid()),
        "token": files._TOKEN,
        "threads": threading.active_count(),
    }


def _kind(descriptor: int) -> str:
    return os.readlink(f"/proc/self/fd/{descriptor}").partition("[")[0].replace(str(os.getpid()), "self")


def _is_inheritable(descriptor: int) -> bool:
    try:
        return os.get_inheritable(descriptor)
    except OSError:
        return False


def answer(process: Process, do: str = "look") -> dict[str, Any]:
    """The reply to one task."""
    process.give(Task(0, "tiny.rule", None, {"do": do}, {}, "/nowhere", "", ""))
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        for line in process.hear()[0]:
            reply: dict[str, Any] = line["reply"]
            return reply
        time.sleep(0.01)
    raise AssertionError(process.log())


def reported(pool: LocalExecutor, count: int) -> list[Any]:
    """The next reports of a pool."""
    reports: list[Any] = []
    deadline = time.monotonic() + 60
    while len(reports) < count and time.monotonic() < deadline:
        reports += pool.poll(1.0)
    return reports


def seen_by(nursery: Nursery, *, workers: int = 1) -> list[dict[str, Any]]:
    """What tasks see in workers of a nursery."""
    nursery.load(HERE, {"NURSERY": "yes"}, [entry for entry in sys.path if entry])
    made = [Process(nursery, devices=(str(number),)) for number in range(workers)]
    try:
        return [answer(process) for process in made]
    finally:
        for process in made:
            process.end(1.0)
        nursery.end()


def test_variables_may_be_said_after_what_to_load() -> None:
    nursery = Nursery()
    nursery.load(HERE, {"NURSERY": "no"}, [entry for entry in sys.path if entry])
    assert json.loads(seen_by(nursery)[0]["output"])["NURSERY"] == "yes"


_SCRIPT = """
import json, os, sys
from dextera_build.engine.executors.nursery import Nursery
from tests.engine.test_nursery import seen_by
secret = os.open(sys.argv[1], os.O_RDONLY)
os.set_inheritable(secret, True)
print(json.dumps([seen_by(Nursery(forked=how))[0]["output"] for how in (False, True)]))
"""


def test_a_worker_of_a_fork_is_as_one_of_a_process_that_was_started_for_it(tmp_path: Path) -> None:
    (tmp_path / "secret").touch()
    root = Path(__file__).parents[2]
    script = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(tmp_path / "secret")],
        env={**os.environ, "PYTHONPATH": str(root)},
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    started, forked = map(json.loads, json.loads(script.stdout))
    assert forked == started
    assert started["stdin"] == os.devnull
    assert started["inherited"] == []
    assert str(tmp_path / "secret") not in started["files"]
    assert started["main"].endswith("engine/nursery.py")
    assert started["leads its group"]
    assert started["session"]


def test_workers_share_what_makes_them_and_nothing_else() -> None:
    nursery = Nursery()
    first, second = seen_by(nursery, workers=2)
    assert first["pids"][1] == second["pids"][1] == nursery.pid
    assert first["pids"][0] != second["pids"][0]
    assert first["token"] != second["token"]  # names of files that are being written
    devices = [json.loads(one["output"])["CUDA_VISIBLE_DEVICES"] for one in (first, second)]
    assert devices == ["0", "1"]


def test_where_what_is_loaded_starts_threads_nothing_is_forked() -> None:
    nursery = Nursery()
    os.environ["NURSERY_THREADS"] = "yes"
    try:
        (seen,) = seen_by(nursery)
    finally:
        del os.environ["NURSERY_THREADS"]
    assert seen["threads"] == 1


def test_a_worker_is_seen_to_die_though_a_child_of_it_holds_its_pipe(tmp_path: Path) -> None:
    with LocalExecutor(HERE, 1) as pool:
        pool.submit(Task(0, "tiny.rule", None, {"do": "leave a child"}, {}, str(tmp_path), "", ""))
        said, ended = reported(pool, 2)
        assert ended.error.message == "worker died (signal 9)"
        assert gone([int(said.data["text"])])


def test_workers_die_with_what_made_them_and_others_come(tmp_path: Path) -> None:
    sleep, see = ({"do": do} for do in ("sleep", "look"))
    with LocalExecutor(HERE, 2) as pool:
        pool.submit(Task(0, "tiny.rule", None, sleep, {}, str(tmp_path), "", ""))
        assert reported(pool, 1)[0].data["text"] == "began"
        (worker,) = pool.pids()
        assert pool._nursery is not None
        os.kill(pool._nursery.pid, signal.SIGKILL)
        (ended,) = reported(pool, 1)
        assert ended.error.message == "worker died (signal 9)"
        assert gone([worker])
        pool.submit(Task(1, "tiny.rule", None, see, {}, str(tmp_path), "", ""))
        assert reported(pool, 1)[0].reply["pids"][0] != worker


def test_a_worker_that_the_system_refuses_is_told(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(nursery: Nursery, descriptors: object, environment: object, made: Callable[[int], None]) -> None:
        made(-11)
        nursery.has_news = True

    monkeypatch.setattr(Nursery, "make", refuse)
    with LocalExecutor(RUNNER, 1) as pool, pytest.raises(MachineError, match="cannot be started") as caught:
        build(graph(call("a")), [("a",)], store=store, executor=pool, listen=Record())
    assert caught.value.code == "DXB-E202"
    assert caught.value.facts["system says"] == "Resource temporarily unavailable"
