"""Data of a pair: more episodes are made beside those that there are, and none is made again."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.e2e.space import Space

MADE = ("build", "task/ob/bimanual_lift_box:data", "--profile", "stub", "--set", "shards.per_shard=10")


@pytest.mark.slow
def test_more_episodes_leave_the_first_ones_alone(tmp_path: Path) -> None:
    space = Space(tmp_path)
    first = space.build(*MADE[1:], "--set", "shards.episodes=20")
    assert first.code == 0, first.err[-3000:]
    assert {"made[00000].episodes", "made[00010].episodes", "episodes", "yields"} <= first.nodes("ran")
    more = space.build(*MADE[1:], "--set", "shards.episodes=40")
    assert more.code == 0, more.err[-3000:]
    made = {name for name in more.nodes("ran") if name.startswith("made[")}
    assert made == {"made[00020].episodes", "made[00030].episodes"}
    assert not more.nodes("ran") & {"sources", "task", "attempts"}
