"""Ctrl-C, and a build that is killed: no process is left, and what was finished stays."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dextera_build.engine.run import build
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, graph, inline, out
from tests.interrupts import hear_interrupts

_SCRIPT = """
import sys
from pathlib import Path
from dextera_build.runs.log import EventLog
from dextera_build.runs.events import fan_out
from dextera_build.engine.run import build
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.store.store import Store
from tests.engine.tiny import RUNNER, call, graph, out

store = Store(Path(sys.argv[1]))
plan = graph(call("quick"), call("slow", "sleep", 60, x=out("quick")), call("end", x=out("slow")))
with EventLog(store) as log, LocalExecutor(RUNNER, Capacity(2, 4.0)) as pool:
    def tell(event):
        if type(event).__name__ == "NodeStarted" and event.node == "slow":
            print(*pool.pids(), flush=True)
    build(plan, [("end",)], store=store, executor=pool, listen=fan_out(log, tell), pause=log.flush)
"""


def start(store: Path) -> tuple[subprocess.Popen[str], list[int]]:
    root = Path(__file__).parents[2]
    child = subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, str(store)],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_interrupts(),
    )
    assert child.stdout is not None
    line = child.stdout.readline()  # printed just before the task is handed over
    assert line, child.stderr.read() if child.stderr else ""
    time.sleep(0.3)
    return child, [int(pid) for pid in line.split()]


def gone(pids: list[int], within_s: float = 30.0) -> bool:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if not any(Path(f"/proc/{pid}/cmdline").exists() and _state(pid) not in "ZX" for pid in pids):
            return True
        time.sleep(0.05)
    return False


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "X"


def finish(store: Path) -> list[str]:
    """Build the first node again; returns what ran."""
    record = Record()
    build(graph(call("quick")), [("quick",)], store=Store(store), executor=inline(), listen=record)
    return record.with_status("ran")


def test_ctrl_c_ends_the_workers_and_keeps_what_is_done(tmp_path: Path) -> None:
    child, workers = start(tmp_path / "store")
    child.send_signal(signal.SIGINT)
    _, errors = child.communicate(timeout=40)  # the node would sleep on for a minute
    assert "KeyboardInterrupt" in errors
    assert gone(workers)
    lines = (tmp_path / "store" / "runs" / "0001" / "events.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    status = {event["node"]: event["status"] for event in events if event["event"] == "node_finished"}
    assert status == {"quick": "ran", "slow": "cancelled", "end": "cancelled"}
    assert events[-1]["event"] == "run_finished"
    assert events[-1]["interrupted"]
    assert finish(tmp_path / "store") == []


@pytest.mark.medium
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process that its parent died")
def test_workers_of_a_killed_build_end_by_themselves(tmp_path: Path) -> None:
    child, workers = start(tmp_path / "store")
    child.kill()
    child.communicate()
    assert gone(workers)
    assert finish(tmp_path / "store") == []


def test_an_interrupt_inside_the_engine_is_passed_on(tmp_path: Path) -> None:
    class Interrupted(Record):
        def __call__(self, event: object) -> None:
            super().__call__(event)  # type: ignore[arg-type]
            if type(event).__name__ == "NodeStarted" and event.node == "b":  # type: ignore[attr-defined]
                raise KeyboardInterrupt

    record, store = Interrupted(), Store(tmp_path / "store")
    with pytest.raises(KeyboardInterrupt):
        build(graph(call("a"), call("b", x=out("a"))), [("b",)], store=store, executor=inline(), listen=record)
    assert record.with_status("ran") == ["a"]
    assert record.with_status("cancelled") == ["b"]
    second = Record()
    build(graph(call("a"), call("b", x=out("a"))), [("b",)], store=store, executor=inline(), listen=second)
    assert second.with_status("cached") == ["a"]
