"""Names that a recipe binds stay when parsing names the objects differently."""

from __future__ import annotations

import pytest

from tests.e2e.space import Space

TWIN, TASK = "twin/laptop_scene", "task/lift_blue_mug:task"
BOUND = ("blue_mug", "black_laptop")


@pytest.mark.slow
def test_another_proposer_renames_nothing_that_is_bound(tmp_path):
    """The stub calls everything `object`, `object_2`...; `clusters` finds names of its own."""
    space = Space(tmp_path)
    first = space.build(f"{TWIN}:body.mesh", "--profile", "stub")
    assert first.code == 0, first.err[-3000:]
    assert {f"body[{name}].mesh" for name in BOUND} <= first.nodes("ran")
    again = space.build(f"{TWIN}:body.mesh", "--profile", "stub", "--backend", "factorize.parse=clusters")
    assert again.code == 0, again.err[-3000:]
    assert {"parse", "named"} <= again.nodes("ran")
    assert "body[blue_mug].mesh" not in again.nodes("ran")
    for more in ((), ("--backend", "factorize.parse=clusters")):
        task = space.build(TASK, "--profile", "stub", *more)
        assert task.code == 0, task.err[-3000:]
        # The stub takes another object where the scene lacks the named one.
        assert "lift `blue_mug`" in task.err
