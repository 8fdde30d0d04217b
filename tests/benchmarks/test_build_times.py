"""How long dxb itself takes: start-up, and builds of trivial nodes. Prints a table; asserts nothing about time.

`make bench` runs it; `DXB_BENCH_NODES=10000 make bench` sets the number of nodes.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

NODES = int(os.environ.get("DXB_BENCH_NODES", "1000"))
RULE = '''"""bench.step: as little work as a node can do."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule


class StepOptions(Options):
    """Options of bench.step."""

    number: int
    """Makes nodes differ."""


@rule(version=1)
def step(ctx: Context, file: File, *, options: StepOptions) -> File:
    """Return the file with the number behind it."""
    return File(data=file.data + str(options.number).encode())
'''


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project with `NODES` nodes that all take one file."""
    (tmp_path / "rules" / "bench").mkdir(parents=True)
    (tmp_path / "rules" / "bench" / "step.py").write_text(RULE)
    (tmp_path / "recipes").mkdir()
    calls = "".join(f"  n{n}: {{rule: bench.step, file: $leaf, number: {n}}}\n" for n in range(NODES))
    targets = ", ".join(f"n{n}" for n in range(NODES))
    text = f"inputs:\n  leaf: leaf.txt\nnodes:\n{calls}targets:\n  default: [{targets}]\n"
    (tmp_path / "recipes" / "wide.yaml").write_text(text)
    (tmp_path / "leaf.txt").write_text("a")
    (tmp_path / "dxb.toml").write_text('cache = "cache"\n')
    return tmp_path


def seconds(project: Path, *words: str) -> float:
    """Wall time of one cold `dxb` process."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("DXB_")}
    began = time.perf_counter()
    command = [str(Path(sys.executable).parent / "dxb"), *words]
    done = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return time.perf_counter() - began


def best(measure: Callable[[], float], times: int = 5) -> float:
    """The least of several measurements: what the program needs where the machine does nothing else."""
    return min(measure() for _ in range(times))


def test_build_times(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [("dxb --help", best(lambda: seconds(project, "--help")))]
    rows.append((f"build, {NODES} nodes, all run", seconds(project, "build", "wide", "--console", "none")))
    rows.append((f"build, {NODES} nodes, no change", best(lambda: seconds(project, "build", "wide"))))
    rows.append((f"plan, {NODES} nodes", best(lambda: seconds(project, "plan", "wide"), 3)))
    (project / "leaf.txt").write_text("b")
    rows.append((f"build, {NODES} nodes, one input changed", seconds(project, "build", "wide", "--console", "none")))
    (project / "leaf.txt").write_text("a")
    rows.append((f"build, {NODES} nodes, changed back", seconds(project, "build", "wide", "--console", "none")))
    with capsys.disabled():
        print(f"\n{platform.machine()}, {len(os.sched_getaffinity(0))} cores, Python {platform.python_version()}")
        for what, took in rows:
            print(f"{what:<42}{took * 1000:>10,.0f} ms")


def test_a_twin_that_is_up_to_date(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "dxb.toml").write_text('cache = "cache"\nprofile = "stub"\n')
    cold = seconds(tmp_path, "build", "twin/laptop_scene", "--console", "none")
    rows = [
        ("python -c pass", best(lambda: bare(tmp_path))),
        ("build twin/laptop_scene, stub profile, all run", cold),
        ("build twin/laptop_scene, no change", best(lambda: seconds(tmp_path, "build", "twin/laptop_scene"))),
        ("the same, plan and keys made anew", best(lambda: seconds(tmp_path, "build", "--check", "twin/laptop_scene"))),
    ]
    with capsys.disabled():
        print()
        for what, took in rows:
            print(f"{what:<48}{took * 1000:>10,.0f} ms{took / rows[0][1]:>8.1f} x bare Python")


def bare(folder: Path) -> float:
    """Wall time of a Python that does nothing."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "pass"], cwd=folder, check=True)
    return time.perf_counter() - began
