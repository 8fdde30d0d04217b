"""`dataset/...`: two episodes of one pair in the twin and one in the reference world, with real backends."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from tests.e2e.space import Space

PAIR = "dataset/kl/lift_mustard_bottle"


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_both_worlds_and_one_more_episode(tmp_path: Path) -> None:
    space = Space(tmp_path)

    def built(count: int) -> tuple[set[str], list[dict[str, str]]]:
        counts = ("--set", f"pair/shards.episodes={count}", "--set", "data/shards.episodes=1")
        targets = (f"{PAIR}:pair/episodes", f"{PAIR}:data/yields", f"{PAIR}:data/recorded_film")
        answer = space.dxb("build", "--console", "jsonl", *targets, *counts, timeout_s=2500.0)
        assert answer.code == 0, answer.err[-3000:]
        files = dict(line.split("\t") for line in answer.out.splitlines())
        table = next(path for name, path in files.items() if name.endswith("data/yields"))
        return answer.nodes("ran"), list(csv.DictReader((tmp_path / table).read_text().splitlines()))

    _, rows = built(2)
    found = {row["episodes"]: (row["world"], row["actor"], row["successes"]) for row in rows}
    assert found == {"twin": ("twin", "synthesis", "2"), "reference": ("reference", "replay", "1")}
    ran, rows = built(3)
    assert {row["successes"] for row in rows} == {"3", "1"}
    assert not [node for node in ran if node.startswith(("data/made", "pair/sources", "twin/"))], (
        "nothing is made again"
    )
