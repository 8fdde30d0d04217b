"""`policy/...`: what training on a second world adds, as one command."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from tests.e2e.space import Space

PAIR = "policy/kl/lift_mustard_bottle"


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_one_pair_compares_both_trainings_in_both_worlds(tmp_path: Path) -> None:
    space = Space(tmp_path)
    target = f"{PAIR}:co_training"
    few = ("--profile", "stub", "--set", "set/pair/shards.episodes=2", "--set", "set/data/shards.episodes=1")
    answer = space.dxb("build", "--console", "jsonl", target, *few, timeout_s=2500.0)
    assert answer.code == 0, answer.err[-3000:]
    assert not answer.nodes("failed", "waits")
    files = dict(line.split("\t") for line in answer.out.splitlines())
    (table,) = (path for name, path in files.items() if name.endswith("co_training"))
    rows = list(csv.DictReader((tmp_path / table).read_text().splitlines()))
    compared = {(row["first"], row["second"]) for row in rows}
    for policy in ("ACT", "DP"):
        for world in ("twin", "reference, tracked"):
            assert (f"{policy}, {world}", f"{policy} twin only, {world}") in compared
    (one,) = (row for row in rows if (row["first"], row["second"]) == ("ACT, twin", "ACT twin only, twin"))
    assert one["starts"] == one["placed alike"] == "100"
    low, difference, high = (float(one[name]) for name in ("from [%]", "difference [%]", "to [%]"))
    assert low <= difference <= high
    again = space.dxb("build", target, *few)
    assert "is up to date" in again.err
