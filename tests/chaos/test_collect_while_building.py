"""Collections in a loop while several processes build: every build is right and loses nothing that it relies on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.store import last_use
from dextera_build.store.store import Store

ROUNDS = 30
BUILDERS = 3
STEP_S, SLACK_S = 0.05, 0.05

_SCRIPT = f"""
import random
import sys
import time
from pathlib import Path
from dextera_build.engine.run import build
from dextera_build.store import last_use
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, graph, inline, out

last_use.STEP_S, last_use.SLACK_S = {STEP_S}, {SLACK_S}


def plan(variant):
    layers = [[call(f"n{{level}}_{{place}}", "blob", variant if place % 2 else 0,
                    **({{"x": out(f"n{{level - 1}}_{{place}}")}} if level else {{}}))
               for place in range(4)] for level in range(4)]
    return graph(*(each for layer in layers for each in layer), default=tuple(each.name for each in layers[-1]))


def run(variant, store):
    what, record = plan(variant), Record()
    result = build(what, what.targets["default"], store=store, executor=inline(), listen=record)
    assert result.ok, [node.error for node in result.nodes.values() if node.error]
    return result, record


root, seed = Path(sys.argv[1]), int(sys.argv[2])
alone = Store(root / f"alone{{seed}}")
right = [{{name: node.output for name, node in run(variant, alone)[0].nodes.items()}} for variant in range(5)]
chance, counts = random.Random(seed), {{"ran": 0, "cached": 0}}
print("ready", flush=True)
sys.stdin.readline()
for _ in range({ROUNDS}):
    variant = chance.randrange(5)
    time.sleep(chance.random() * {2 * STEP_S})
    store = Store(root / "store")
    with store.running.announced():
        result, record = run(variant, store)
        time.sleep(chance.random() * {2 * STEP_S})
        assert {{name: node.output for name, node in result.nodes.items()}} == right[variant]
        lost = [name for name, node in result.nodes.items() if store.actions.get(node.key) is None]
        assert not lost, f"collected under a running build: {{lost}}"
    ended = [event.node for status in counts for event in record.events
             if getattr(event, "status", None) == status for _ in [counts.__setitem__(status, counts[status] + 1)]]
    assert len(ended) == len(set(ended)), "a node that was done was done again"
print(counts["ran"], counts["cached"])
"""


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a twentieth of a second pass for an hour."""
    monkeypatch.setattr(last_use, "STEP_S", STEP_S)
    monkeypatch.setattr(last_use, "SLACK_S", SLACK_S)


@pytest.mark.slow
@pytest.mark.usefixtures("hasty")
def test_builds_lose_nothing_that_they_rely_on(tmp_path: Path) -> None:
    builders = [start(tmp_path, seed) for seed in range(BUILDERS)]
    for builder in builders:
        assert builder.stdout is not None
        assert builder.stdout.readline() == "ready\n"
    for builder in builders:
        assert builder.stdin is not None
        builder.stdin.write("go\n")
        builder.stdin.flush()
    store, dropped, beside = Store(tmp_path / "store"), 0, 0
    while any(builder.poll() is None for builder in builders):
        said = collect(store, dict, Limits(size=0), dry=False)
        dropped += sum(row.count for row in said.gone if row.kind == "results")
        beside += said.running
    said = [builder.communicate(timeout=60)[0] for builder in builders]
    assert [builder.returncode for builder in builders] == [0] * BUILDERS
    ran, cached = (sum(int(text.split()[place]) for text in said) for place in (0, 1))
    # The test is worth nothing unless much was collected, some of it beside builds, and something was found, too.
    assert dropped > 50
    assert beside > 10
    assert ran > 50
    assert cached > 50


def start(folder: Path, seed: int) -> subprocess.Popen[str]:
    repository = Path(__file__).parents[2]
    return subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, str(folder), str(seed)],
        cwd=repository,
        env={**os.environ, "PYTHONPATH": str(repository)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
