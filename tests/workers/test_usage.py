"""What a node used: memory of the worker and its children, processor time, bytes; and that it is remembered."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import build
from dextera_build.runs.history import History
from dextera_build.runs.log import EventLog, read
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.worker import Meter
from tests.engine.tiny import RUNNER, Record, call, graph

MIB = 1 << 20


TWO_TASKS = """
import json
from dextera_build.workers.worker import Meter
meter = Meter()
block = bytearray(200 << 20)
del block
large = meter.end()
meter = Meter()
print(json.dumps([large, meter.end()]))
"""


def test_the_peak_is_that_of_one_task() -> None:
    # In a process of its own: that of the tests may hold freed memory, of which the block would be made.
    done = subprocess.run([sys.executable, "-c", TWO_TASKS], capture_output=True, text=True, check=True)
    large, small = json.loads(done.stdout)
    assert large["memory_bytes"] >= 200 * MIB
    assert small["memory_bytes"] < large["memory_bytes"] - 150 * MIB


def test_a_child_counts_once_it_is_waited_for(tmp_path: Path) -> None:
    meter = Meter()
    write = f"open({str(tmp_path / 'out')!r}, 'wb').write(bytes({5 * MIB}))"
    script = f"x = bytearray({400 * MIB}); {write}; sum(range(4_000_000))"
    subprocess.run([sys.executable, "-c", script], check=True)
    used = meter.end()
    assert used["memory_bytes"] >= 400 * MIB
    assert used["written_bytes"] >= 5 * MIB
    assert used["cpu_seconds"] > 0.02


def test_bytes_and_time_are_differences() -> None:
    meter = Meter()
    used = meter.end()
    # Far less than this process used so far; a collector of garbage, or a thread of the test runner, may use some.
    assert used["cpu_seconds"] < time.process_time() / 2
    assert used["read_bytes"] < MIB
    assert used["written_bytes"] < MIB


@pytest.fixture
def pool() -> Iterator[LocalExecutor]:
    with LocalExecutor(RUNNER, Capacity(1, 4.0)) as executor:
        yield executor


def test_events_and_history_hold_it(store: Store, pool: LocalExecutor) -> None:
    record = Record()
    plan = graph(call("a", "sleep", 0.4))
    with EventLog(store) as log:
        build(plan, plan.targets["default"], store=store, executor=pool, listen=log, policy=RunPolicy(run=log.run))
    (finished,) = (event for event in read(store, log.run) if event["event"] == "node_finished")
    assert set(finished["usage"]) == {"cpu_seconds", "memory_bytes", "read_bytes", "written_bytes"}
    assert 5 * MIB < finished["usage"]["memory_bytes"] < 500 * MIB
    peak = History(store, "tiny/graph").peak_gb("a")
    assert peak is not None
    assert peak * 2**30 == finished["usage"]["memory_bytes"]
    # A cached node keeps what is known of its last run.
    build(plan, plan.targets["default"], store=store, executor=pool, listen=record)
    assert History(store, "tiny/graph").peak_gb("a") == peak


def test_a_history_of_before_is_read(store: Store, pool: LocalExecutor) -> None:
    plan = graph(call("a"))
    build(plan, plan.targets["default"], store=store, executor=pool, listen=Record())
    (kind,) = (kind for kind in store.state.kinds() if kind.startswith("history"))
    row = json.loads(store.state.get(kind, "a") or b"")
    store.state.put(kind, {"a": json.dumps(row[:5]).encode()})
    history = History(store, "tiny/graph")
    assert history.get("a") is not None
    assert history.peak_gb("a") is None


def test_what_a_worker_had_that_died_is_known(store: Store, pool: LocalExecutor) -> None:
    plan = graph(call("a", "kill"))
    result = build(plan, plan.targets["default"], store=store, executor=pool, listen=Record())
    assert result.nodes["a"].status == "failed"
    assert result.nodes["a"].usage["memory_bytes"] > 5 * MIB
