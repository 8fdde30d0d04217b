"""Benchmarks print tables; nothing here asserts a time. Run them with `make bench`."""

from __future__ import annotations

import statistics
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def clock() -> Callable[..., tuple[float, float, float]]:
    """Wall time of a command as a cold process: least, median and greatest of several runs [s]."""

    def run(words: list[str], folder: Path, env: dict[str, str], runs: int = 7) -> tuple[float, float, float]:
        times = []
        for _ in range(runs + 1):
            began = time.perf_counter()
            subprocess.run(words, cwd=folder, env=env, check=True, capture_output=True)
            times.append(time.perf_counter() - began)
        # The first run warms the file cache and is left out.
        return min(times[1:]), statistics.median(times[1:]), max(times[1:])

    return run
