"""A worker is as new to each of its tasks, whatever those before did."""

from __future__ import annotations

import random
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.protocol import Ended, Task
from tests.workers.dirt import DIRT

RESTORED = {"folder", "variable", "mask", "decimal context", "print options", "floating-point errors"}
RESTORED |= {"random state", "locale", "filters of warnings", "recursion limit", "stdout"}


@pytest.fixture(scope="module")
def pool() -> Iterator[LocalExecutor]:
    with LocalExecutor("tests.workers.dirt:run_task", Capacity(1, 4.0)) as executor:
        yield executor


def run(pool: LocalExecutor, do: str) -> dict[str, Any]:
    """The reply of a task."""
    pool.submit(Task(0, "tiny.rule", None, {"do": do}, {}, "/nowhere", "", ""))
    reports: list[object] = []
    while not any(isinstance(report, Ended) for report in reports):
        reports += pool.poll(60.0)
    (ended,) = reports
    assert isinstance(ended, Ended)
    assert ended.error is None
    assert "still here" not in ended.log.decode() or do == "thread"
    return dict(ended.reply or {})


@pytest.mark.parametrize("kind", DIRT)
def test_what_a_task_leaves_does_not_reach_the_next_one(pool: LocalExecutor, kind: str) -> None:
    before = run(pool, "look")
    run(pool, kind)
    after = run(pool, "look")
    assert after["state"] == before["state"]
    assert after["drawn"] != [random.Random(1).random(), np.random.RandomState(1).random()]
    assert (after["pid"] == before["pid"]) == (kind in RESTORED)


def test_a_worker_stays_although_a_task_started_its_first_thread() -> None:
    # The C library handles signal 33 from the first thread on, so a new process is needed.
    code = """if True:
        import threading
        from dextera_build.workers.leftovers import Leftovers
        noted = Leftovers()
        thread = threading.Thread(target=len, args=("",))
        thread.start()
        thread.join()
        print(repr(noted.clear()))
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "''\n"
