"""Six builds of one graph at once, by processes that share a store: each node runs once."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

_SCRIPT = """
import sys
from pathlib import Path
from dextera_build.engine.run import build
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.store.store import Store
from tests.engine.tiny import RUNNER, Record, call, graph, out

store = Store(Path(sys.argv[1]))
layers = [[call(f"n{level}_{place}", "sleep", 0.02, **({"x": out(f"n{level - 1}_{place}")} if level else {}))
           for place in range(5)] for level in range(6)]
plan = graph(*(each for layer in layers for each in layer), default=tuple(each.name for each in layers[-1]))
print("ready", flush=True)
sys.stdin.readline()
with LocalExecutor(RUNNER, Capacity(2, 4.0)) as pool:
    result = build(plan, plan.targets["default"], store=store, executor=pool, listen=Record())
print(*sorted(f"{name}={node.output}" for name, node in result.nodes.items()))
sys.exit(not result.ok)
"""


@pytest.mark.medium
def test_each_node_runs_once_across_processes(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    trace = tmp_path / "trace"
    environment = {**os.environ, "PYTHONPATH": str(root), "TINY_TRACE": str(trace)}
    builders = [
        subprocess.Popen(
            [sys.executable, "-c", _SCRIPT, str(tmp_path / "store")],
            cwd=root,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(6)
    ]
    for builder in builders:
        assert builder.stdout is not None
        assert builder.stdout.readline() == "ready\n"
    for builder in builders:
        assert builder.stdin is not None
        builder.stdin.write("go\n")
        builder.stdin.flush()
    outputs = {builder.communicate(timeout=300)[0] for builder in builders}
    assert [builder.returncode for builder in builders] == [0] * 6
    assert len(outputs) == 1  # all came to the same result
    ran = Counter(trace.read_text().split())
    assert len(ran) == 30
    assert set(ran.values()) == {1}
