"""Promise: a data set goes through the store, into batches and out again in memory that does not grow with it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("av")
REPO = Path(__file__).parent.parent.parent
WIDTH, HEIGHT, EPISODES, FRAMES = 320, 240, 20, 60
MOST_MIB = 256


@pytest.mark.slow
def test_the_peak_is_bounded(tmp_path: Path) -> None:
    """The pictures alone take 553 MB; a process of its own, so that its peak is that of this work."""
    numbers = ["--episodes", EPISODES, "--frames", FRAMES, "--size", WIDTH, HEIGHT, "--batches", 3]
    command = [sys.executable, "-m", "tests.benchmarks.episodes", *map(str, numbers), "--root", str(tmp_path / "root")]
    done = subprocess.run(command, cwd=REPO, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert 2 * EPISODES * FRAMES * WIDTH * HEIGHT * 3 > 2 * MOST_MIB * 2**20
    assert found["frames"] == 2 * EPISODES * FRAMES
    assert found["peak [MiB]"] < MOST_MIB
