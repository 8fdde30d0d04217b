"""The page about observation terms: one file adds a term to a project, and nothing else becomes stale."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Shard
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError
from dextera_build.sim.experts import planning
from dextera_build.testing import RuleRunner
from rules.demonstrate import lerobot_features
from tests import episodes, gate, task_bundles
from tests.e2e.page import blocks, planned, stale
from tests.e2e.space import Space
from tests.policy import policies

ADDED = {"palm_to_object", "palm_episodes", "palm_act", "palm_twin"}
SMALL = {"steps": 20, "width": 16, "heads": 2, "chunk": 4, "latent": 2, "batch": 8}


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path)
    made.write("dxb.toml", "")
    return made


def add_term(space: Space) -> None:
    """Write the two files of the page."""
    space.write("rules/terms/palm_to_object.py", blocks("terms", "python")[0])
    space.write("recipes/task/palm.yaml", blocks("terms", "yaml")[0])


@pytest.mark.medium
def test_adding_and_editing_a_term_makes_its_own_nodes_stale_alone(space: Space) -> None:
    first = planned(space, "task/close_laptop")
    add_term(space)
    added = planned(space, "task/palm")
    assert stale(first, added) == ADDED
    assert stale(first, planned(space, "task/close_laptop")) == set()
    space.edit("rules/terms/palm_to_object.py", "worlds.palms[..., :3]", "2.0 * worlds.palms[..., :3]")
    # Whether the policy is trained again depends on whether the demonstrations are others.
    assert stale(added, planned(space, "task/palm")) == ADDED - {"palm_act"}


@pytest.mark.medium
def test_a_policy_sees_the_term_of_the_page_as_it_was_recorded(space: Space, tmp_path: Path) -> None:
    add_term(space)
    bundle, made_by = gate.bundle(), {"checkpoint": "learn.act", "terms": "terms.palm_to_object"}
    runner = RuleRunner(tmp_path / "scratch", space.root, made_by=made_by)
    terms = Collection[TermSpec](items={"palm_to_object": runner.run("terms.palm_to_object")})
    blind = policies.contract(bundle)
    action = blind.action.model_copy(update={"mean": (gate.target(gate.PUSHES),), "scale": (0.0,)})
    pushes = policies.checkpoint(blind.model_copy(update={"action": action}))
    inputs = {"bundle": bundle, "checkpoint": pushes, "terms": terms}
    shown = runner.run("evaluate.rollouts", **inputs, options={"trials": 2}).examples
    episode = shown.items["0"]
    wanted = episode.objects[:, None, 0, :3] - episode.hand[..., :3]
    assert np.ptp(episode.hand[..., :3], axis=0).max() > 0.1
    assert np.allclose(episode.terms["palm_to_object"], wanted, atol=1e-6)
    assert lerobot_features.features(shown, ()).get("observation.palm_to_object").names == ("x", "y", "z")
    made = runner.run(
        "learn.act", bundle=bundle, episodes=shown, options={"inputs": ["joints", "palm_to_object"]} | SMALL
    )
    assert [(channel.name, channel.shape) for channel in made.contract.inputs] == [
        ("joints", (1,)),
        ("palm_to_object", (1, 3)),
    ]
    inputs = {"bundle": bundle, "checkpoint": made, "terms": terms}
    assert len(runner.run("evaluate.rollouts", **inputs, options={"trials": 2}).items) == 2
    with pytest.raises(RuleError, match="does not fit the task bundle: no channel `palm_to_object`"):
        runner.run("evaluate.rollouts", bundle=bundle, checkpoint=made, options={"trials": 1})


MORE = """
extends: task/palm
nodes:
  more:
    each: $shards
    as: shard
    nodes:
      palm_more:
        rule: demonstrate.synthesize
        bundle: $task
        sources: $palm_episodes
        shard: $shard
        terms: {palm_to_object: $palm_to_object}
  palm_ppo:
    rule: learn.ppo
    bundle: $task
    inputs: [joints, previous_action, goal, palm_to_object]
    terms: {palm_to_object: $palm_to_object}
"""


@pytest.mark.medium
def test_a_recipe_gives_the_term_to_every_rule_that_simulates(space: Space) -> None:
    add_term(space)
    space.write("recipes/task/more.yaml", MORE)
    calls = {".".join(path): call for path, call in planned(space, "task/more").graph.calls()}
    for name in ("palm_episodes", "more.palm_more", "palm_ppo", "palm_twin"):
        assert any("terms/palm_to_object.py" in file for file in calls[name].rule.code), name


def test_demonstrations_in_mujoco_record_the_term(
    space: Space, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An operator that holds still, and what is synthesised from it."""
    add_term(space)
    monkeypatch.setattr(planning, "practise", lambda *_, **__: planning.Unable("holds still"))
    runner = RuleRunner(tmp_path / "scratch", space.root, made_by={"terms": "terms.palm_to_object"})
    terms = Collection[TermSpec](items={"palm_to_object": runner.run("terms.palm_to_object")})
    bundle = episodes.bundle()
    inputs = {"bundle": bundle, "terms": terms}
    shown = runner.run("demonstrate.operate", backend="mujoco", **inputs, options={"attempts": 1})
    (episode,) = shown.failures.values()
    own = list(bundle.objects).index(bundle.task.object)
    wanted = episode.objects[:, None, own, :3] - episode.hand[..., :3]
    assert np.allclose(episode.terms["palm_to_object"], wanted, atol=1e-6)
    assert list(shown.terms) == ["palm_to_object"]
    # What is synthesised from it fails, but after its simulation.
    inputs |= {"sources": shown.model_copy(update={"items": shown.failures}), "shard": Shard(first=0, count=1, seed=0)}
    with pytest.raises(RuleError, match="only 0 of 1 episodes of `LiftBox` came out"):
        runner.run("demonstrate.synthesize", backend="mujoco", **inputs, options={"tries": 1})


@pytest.mark.medium
def test_a_policy_practises_with_the_term_and_acts_by_it(space: Space, tmp_path: Path) -> None:
    add_term(space)
    made_by = {"terms": "terms.palm_to_object", "checkpoint": "learn.ppo"}
    runner = RuleRunner(tmp_path / "scratch", space.root, made_by=made_by)
    terms = Collection[TermSpec](items={"palm_to_object": runner.run("terms.palm_to_object")})
    inputs = {"bundle": task_bundles.close(), "terms": terms}
    options = {
        "inputs": ["joints", "previous_action", "palm_to_object"],
        "steps": 32,
        "worlds": 2,
        "rollout": 16,
        "batch": 16,
        "width": 16,
    }
    made = runner.run("learn.ppo", backend="sb3", **inputs, options=options)
    assert [channel.name for channel in made.contract.inputs] == ["joints", "previous_action", "palm_to_object"]
    assert len(runner.run("evaluate.rollouts", **inputs, checkpoint=made, options={"trials": 1}).items) == 1


@pytest.mark.slow
def test_the_commands_of_the_page_run_and_only_what_was_added_runs(space: Space) -> None:
    before = space.build("task/close_laptop", "--profile", "stub")
    assert before.code == 0, before.err[-3000:]
    add_term(space)
    for command in (line[2:] for line in blocks("terms", "console")[0].splitlines()):
        words = shlex.split(command)[1:]
        done = space.build(*words[1:]) if words[0] == "build" else space.dxb(*words)
        assert done.code == 0, done.err[-3000:]
        if words[0] == "build":
            assert done.nodes("ran") == ADDED
    assert "palm_to_object" in done.out
    space.edit("rules/terms/palm_to_object.py", "worlds.palms[..., :3]", "2.0 * worlds.palms[..., :3]")
    why = space.dxb("why", "task/palm:palm_twin", "--profile", "stub")
    assert "`measure` of rules/terms/palm_to_object.py" in why.out, why.out
    # Without a simulator the term is 0 as before, so the policy is not trained again.
    assert space.build("task/palm", "--profile", "stub").nodes("ran") == ADDED - {"palm_act"}
