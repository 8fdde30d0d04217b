"""Promise: a data set goes through the store, into batches and out again in memory that does not grow with it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("av")
pytest.importorskip("psutil")
pytest.importorskip("pyarrow")
REPO = Path(__file__).parent.parent.parent
WIDTH, HEIGHT, EPISODES, FRAMES = 320, 240, 20, 60
MOST_MIB = 1024
"""For all processes of a step together."""


@pytest.mark.slow
def test_the_peak_is_bounded(tmp_path: Path) -> None:
    """The pictures alone take 553 MB, so that a process that holds them beside its libraries is near the bound."""
    numbers = ["--episodes", EPISODES, "--frames", FRAMES, "--size", WIDTH, HEIGHT, "--batches", 3]
    command = [sys.executable, "-m", "tests.benchmarks.data_set", *map(str, numbers), "--root", str(tmp_path / "root")]
    done = subprocess.run(command, cwd=REPO, capture_output=True, text=True, check=True)
    found = {step["step"]: step for step in map(json.loads, done.stdout.splitlines())}
    assert {name: step["pictures"] for name, step in found.items()} == {
        "write": 2 * EPISODES * FRAMES,
        "read": 2 * 3 * 32,
        "unpack": 2 * EPISODES * FRAMES,
        "sample": 2 * 3 * 32,
        "export": 2 * EPISODES * FRAMES,
        "lerobot": 2 * EPISODES * FRAMES,
    }
    assert all(0 < step["peak [MiB]"] < MOST_MIB for step in found.values()), found
    assert max(found[name]["peak [MiB]"] for name in ("read", "unpack", "export", "lerobot")) < MOST_MIB / 4
