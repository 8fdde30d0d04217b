"""The page about policy algorithms: its files add an algorithm to a project, and nothing else becomes stale."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from dextera_build.code.loader import bundled
from dextera_build.testing import RuleRunner
from tests import gate
from tests.e2e.page import blocks, planned, stale
from tests.e2e.space import Space
from tests.policy import policies

TRIALS = {
    *("act_or_ppo", "act_early", "act_twin", "act_plain_twin", "act_reference", "act_cell"),
    *("act_image_twin", "act_image_reference", "published/act_twin"),
}
"""Nodes of task/close_laptop that run a policy of learn.act."""


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path)
    made.write("dxb.toml", "")
    return made


def add_nearest(space: Space) -> None:
    """Write the files of the page."""
    space.write("rules/learn/nearest/nearest.py", blocks("policies", "python")[0])
    space.write("rules/learn/nearest/policy.py", blocks("policies", "python")[1])
    space.write("recipes/task/nearest.yaml", blocks("policies", "yaml")[0])


@pytest.mark.slow
def test_adding_and_editing_an_algorithm_makes_its_own_nodes_stale_alone(space: Space) -> None:
    first = planned(space, "task/close_laptop")
    add_nearest(space)
    added = planned(space, "task/nearest")
    assert stale(first, added) == {"nearest", "nearest_twin"}
    space.edit("rules/learn/nearest/policy.py", "np.square(", "np.abs(")
    assert stale(added, planned(space, "task/nearest")) == {"nearest_twin"}
    # A copy in the project takes the place of the one that comes with dxb, and what it trains is what that trained.
    shutil.copytree(bundled("rules") / "learn" / "act", space.root / "rules/learn/act")
    copied = planned(space, "task/close_laptop")
    assert stale(first, copied) == TRIALS
    space.edit("rules/learn/act/policy.py", "made(running", "1 * made(running")
    assert stale(copied, planned(space, "task/close_laptop")) == TRIALS


@pytest.mark.slow
def test_the_policy_of_the_page_does_what_was_shown(space: Space, tmp_path: Path) -> None:
    add_nearest(space)
    bundle = gate.bundle()
    contract = policies.contract(bundle)
    action = contract.action.model_copy(update={"mean": (gate.target(gate.PUSHES),), "scale": (0.0,)})
    shown = policies.checkpoint(contract.model_copy(update={"action": action}))
    runner = RuleRunner(tmp_path / "act", made_by={"checkpoint": "learn.act"})
    episodes = runner.run("evaluate.rollouts", bundle=bundle, checkpoint=shown, options={"trials": 2}).examples
    runner = RuleRunner(tmp_path / "nearest", space.root, made_by={"checkpoint": "learn.nearest"})
    made = runner.run("learn.nearest", bundle=bundle, episodes=episodes)
    assert made.contract.algorithm == "nearest"
    found = runner.run("evaluate.rollouts", bundle=bundle, checkpoint=made, options={"trials": 3})
    assert (found.successes, found.label, found.algorithm) == (3, "NEAREST", "nearest")
    again = runner.run("learn.nearest", bundle=bundle, episodes=episodes)
    assert again.weights == made.weights
    assert np.array_equal(again.contract.action.mean, made.contract.action.mean)


@pytest.mark.slow
def test_the_commands_of_the_page_run_and_only_what_was_added_runs(space: Space) -> None:
    before = space.build("task/close_laptop", "--profile", "stub")
    assert before.code == 0, before.err[-3000:]
    add_nearest(space)
    # The commands further down train the algorithms of dxb for hours.
    commands = [line[2:] for line in blocks("policies", "console")[0].splitlines() if line.startswith("$ ")]
    assert any(command.startswith("dxb build") for command in commands)
    for command in commands:
        words = shlex.split(command)[1:]
        done = space.build(*words[1:]) if words[0] == "build" else space.dxb(*words)
        assert done.code == 0, done.err[-3000:]
        if words[0] == "build":
            assert done.nodes("ran") == {"nearest", "nearest_twin"}
    space.edit("rules/learn/nearest/policy.py", "np.square(", "np.abs(")
    why = space.dxb("why", "task/nearest:nearest_twin", "--profile", "stub")
    assert "`predict` of rules+2/learn/nearest/policy.py" in why.out, why.out
    assert space.build("task/nearest", "--profile", "stub").nodes("ran") == {"nearest_twin"}
