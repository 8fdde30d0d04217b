"""The program that says what a trivial node costs."""

from __future__ import annotations

import subprocess
import sys

from tests.benchmarks.node import REPO


def test_a_row_for_each_checkout_with_positive_times(tmp_path):
    words = ["--nodes", "60", "--repeats", "1", "--jobs", "1", "--beside", str(REPO), "--work", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.node", *words], cwd=REPO, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    titles, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines()]
    assert len(rows) == 2
    for row in rows:
        cost = dict(zip(titles[1:], map(float, row[1:]), strict=True))
        assert cost["scheduler [ms]"] > 0
        assert cost["memory [MiB]"] > 10
    assert list(tmp_path.iterdir()) == []
