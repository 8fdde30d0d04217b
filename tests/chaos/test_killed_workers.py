"""Workers that are killed at random moments: every build after it goes on from what was finished."""

from __future__ import annotations

import os
import random
import signal
from pathlib import Path

from dextera_build.engine.graph import Graph
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import build
from dextera_build.runs.events import Event, NodeStarted, fan_out
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from tests.engine.tiny import RUNNER, Record, call, graph, inline, out


def layers() -> Graph:
    """Four chains of four nodes."""
    nodes = [call(f"n0_{place}", "blob") for place in range(4)]
    for level in range(1, 4):
        nodes += [call(f"n{level}_{place}", "blob", x=out(f"n{level - 1}_{place}")) for place in range(4)]
    return graph(*nodes, default=tuple(f"n3_{place}" for place in range(4)))


def test_builds_converge_though_workers_are_killed(tmp_path: Path) -> None:
    clean = build(
        layers(), layers().targets["default"], store=Store(tmp_path / "a"), executor=inline(), listen=Record()
    )
    dice, store = random.Random(1), Store(tmp_path / "b")
    finished: set[str] = set()
    deaths = 0
    for _ in range(60):
        with LocalExecutor(RUNNER, Capacity(2, 4.0)) as pool:

            def shoot(event: Event, pool: LocalExecutor = pool) -> None:
                if isinstance(event, NodeStarted) and pool.pids() and dice.random() < 0.3:
                    os.kill(dice.choice(pool.pids()), signal.SIGKILL)

            record = Record()
            result = build(
                layers(),
                layers().targets["default"],
                store=store,
                executor=pool,
                listen=fan_out(record, shoot),
                policy=RunPolicy(keep_going=True),
            )
        assert finished <= set(record.with_status("cached"))  # nothing that was done is lost
        finished |= set(record.with_status("ran"))
        for name in record.with_status("failed"):
            deaths += 1
            error = result.nodes[name].error
            assert error is not None
            assert error.code == "DXB-B301"
        if result.ok:
            break
    assert result.ok
    assert deaths > 0
    assert {name: node.output for name, node in result.nodes.items()} == {
        name: node.output for name, node in clean.nodes.items()
    }
