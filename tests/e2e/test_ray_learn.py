"""A policy is trained and tried on a real Ray cluster, with the results of one machine."""

from __future__ import annotations

import importlib.util

import pytest

from tests.e2e import test_two_cameras
from tests.e2e.raylets import raylets
from tests.e2e.space import Answer, Space

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="ray is not installed: `make test-all`"),
    pytest.mark.timeout(900),
]

RECIPE = """
summary: Two policies on states, each of which has a machine of the cluster.
inputs:
  task_file: data/gate.json
  episodes_file: data/episodes.json
nodes:
  task: {rule: demo.task, stored: $task_file, primitive: articulate, articulate: {joints_deg: {hinge: 0}}}
  episodes: {rule: demo.episodes, stored: $episodes_file}
  act: {rule: learn.act, bundle: $task, episodes: $episodes, steps: 20, width: 32, heads: 2, chunk: 5}
  again: {rule: learn.act, bundle: $task, episodes: $episodes, steps: 20, width: 32, heads: 2, chunk: 5, seed: 1}
  act_twin: {rule: evaluate.rollouts, bundle: $task, checkpoint: $act, trials: 2}
  again_twin: {rule: evaluate.rollouts, bundle: $task, checkpoint: $again, trials: 2}
targets:
  default: [act_twin, again_twin]
"""


def outputs(answer: Answer) -> dict[str, str]:
    """Digest of what each node made."""
    assert answer.code == 0, answer.err[-3000:]
    ended = [event for event in answer.events if event["event"] == "node_finished"]
    return {event["node"]: event["output"] for event in ended if event["status"] == "ran"}


def test_policies_are_trained_on_ray_and_equal_those_of_one_machine(space: Space) -> None:
    test_two_cameras.project(space)
    space.write("recipes/task/two.yaml", RECIPE)
    space.write("dxb.toml", 'cache = "cache"\n[remotes]\nshared = {address = "shared", mode = "rw"}\n')
    with raylets() as cluster:
        words = ("build", "--console", "jsonl", "task/two", "--executor", f"ray:{cluster.address}")
        there = outputs(space.run(*words))
    here = outputs(
        space.dxb("build", "--console", "jsonl", "task/two", env={"DXB_CACHE": "alone", "DXB_REMOTES": "./none:rw"})
    )
    assert there == here
    assert {"act", "again", "act_twin", "again_twin"} <= set(there)
