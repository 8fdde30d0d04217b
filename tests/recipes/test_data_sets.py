"""`dataset/...`: episodes of one pair in the twin and in the reference world, and a replay, with real backends."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from tests.e2e.space import Space

PAIR = "dataset/kl/lift_mustard_bottle"
TASK = "KL: LiftMustardBottle"
NODES = ("pair/episodes", "data/yields", "data/lerobot", "data/replayed")
PUBLISHED = "100 / 20, replay 30"


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_both_worlds_and_one_more_episode(tmp_path: Path) -> None:
    space = Space(tmp_path)

    def built(count: int) -> tuple[set[str], list[dict[str, str]]]:
        counts = [f"pair/shards.episodes={count}", "data/shards.episodes=1", "data/replay.trials=1"]
        targets = [f"{PAIR}:{node}" for node in NODES]
        settings = [word for each in counts for word in ("--set", each)]
        answer = space.dxb("build", "--console", "jsonl", *targets, *settings, timeout_s=2500.0)
        assert answer.code == 0, answer.err[-3000:]
        files = dict(line.split("\t") for line in answer.out.splitlines())

        def table(node: str) -> list[dict[str, str]]:
            path = next(path for name, path in files.items() if name.endswith(node))
            return list(csv.DictReader((tmp_path / path).read_text().splitlines()))

        replays = {row["worlds"]: row["trials"] for row in table("data/replayed") if row["task"] == TASK}
        assert replays == {"twin / reference, tracked": "replay 1", "paper: simulation / hardware": PUBLISHED}
        card = next((tmp_path / path).read_text() for name, path in files.items() if name.endswith("data/lerobot"))
        assert "Domain: the reference world: a simulation" in card
        return answer.nodes("ran"), table("data/yields")

    _, rows = built(2)
    found = {row["episodes"]: (row["world"], row["actor"], row["successes"]) for row in rows}
    assert found == {"twin": ("twin", "synthesis", "2"), "reference": ("reference", "replay", "1")}
    ran, rows = built(3)
    assert {row["successes"] for row in rows} == {"3", "1"}
    assert not [node for node in ran if node.startswith(("data/made", "pair/sources", "twin/"))], (
        "nothing is made again"
    )
