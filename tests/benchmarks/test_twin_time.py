"""The program that prints the processor time of twins."""

from __future__ import annotations

import os
import sys

import pytest

from tests.benchmarks import twin_time

BUSY = "import time\nwhile time.process_time() < 0.3: pass"


def test_the_time_of_children_counts_and_that_of_waiting_does_not() -> None:
    parent = f"import subprocess, sys, time; time.sleep(0.4); subprocess.run([sys.executable, '-c', {BUSY!r}])"
    assert 0.3 <= twin_time.spent([sys.executable, "-S", "-c", parent], os.environ) < 0.9
    with pytest.raises(SystemExit, match="exit status 3"):
        twin_time.spent([sys.executable, "-c", "raise SystemExit(3)"], os.environ)


def test_every_node_counts_in_one_column_and_the_rest_in_another() -> None:
    nodes = {
        "photo": ("capture.folder", 1.0),
        "body[mug].mesh": ("factorize.mesh", 4.0),
        "body[can].mesh": ("factorize.mesh", 3.0),
        "background": ("background.static", 2.0),
        "overlay": ("evaluate.overlay", 0.5),
    }
    events: list[dict[str, object]] = [{"event": "run_started"}]
    for node, (rule, seconds) in nodes.items():
        events.append({"event": "node_started", "node": node, "rule": rule})
        events.append({"event": "node_finished", "node": node, "usage": {"cpu_seconds": seconds}})
    events.append({"event": "node_finished", "node": "cached", "usage": {}})
    found = twin_time.shares(events, 12.0)
    assert found == {"meshes": 7.0, "background": 2.0, "overlay": 0.5, "other nodes": 1.0, twin_time.REST: 1.5}
