"""The rasteriser on the CPU: 50,000 Gaussians at 640 x 480, kernels compiled, from the cache, and warm.

`make bench ARGS='-k rasteriser'` prints the table in docs/benchmarks/gaussians.md.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.benchmarks import rasteriser

pytest.importorskip("warp", reason="warp-lang is not installed: extra `warp`")
pytestmark = pytest.mark.slow

TARGET_S = 2.0
"""Forward and backward on two cores; processor time is compared, which does not depend on what else runs."""


def process(cache: Path, *arguments: str) -> dict[str, float]:
    command = [sys.executable, "-m", "tests.benchmarks.rasteriser", *arguments]
    environment = os.environ | {"WARP_CACHE_PATH": str(cache)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_passes_of_the_rasteriser(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cold, cached = process(tmp_path), process(tmp_path)
    rows = [("degree 0", cached)]
    rows.append(("degree 3", process(tmp_path, "--degree", "3")))
    rows.append(("twice as wide", process(tmp_path, "--width-m", "0.024")))
    rows.append(("one thread", process(tmp_path, "--threads", "1")))
    peer = rasteriser.preview_seconds(rasteriser.scene(50_000))
    with capsys.disabled():
        print("\n50,000 Gaussians, 640 x 480; seconds on the clock (of the processor), the quickest of five")
        print(f"  first passes, kernels compiled       {cold['first']:6.2f}")
        print(f"  first passes, kernels from the cache {cached['first']:6.2f}")
        for name, row in rows:
            ways = "  ".join(f"{way} {row[way]:.3f} ({row[f'{way}_cpu']:.3f})" for way in ("forward", "backward"))
            print(f"  {name:14} {int(row['pairs']):>9,} pairs with tiles  {ways}")
        print(f"  NumPy (`geometry.splatting`)         forward ({peer:.2f})")
    assert cached["first"] < cold["first"]
    for name, row in rows:
        if name != "twice as wide":
            assert row["forward_cpu"] + row["backward_cpu"] < TARGET_S, name
