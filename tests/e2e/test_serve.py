"""`dxb serve`: a policy of a recipe on the wire, asked by another build."""

from __future__ import annotations

import json
import signal
from typing import Any

import pytest

from tests import documents
from tests.e2e.space import Space

TASK = """
summary: A push on the stub twin, by a policy of five steps of training, here and served.
extends: task/lift_blue_mug
nodes:
  base: {rule: align.base, support: $support, position_m: [0.2, -0.75, 0.0], yaw_deg: 90}
  task:
    rule: simulate.task
    scene: $scene
    assets: $assets
    robot: $robot
    base: $base
    name: Try
    primitive: push
    object: blue_mug
    push: {by_m: [0.05, 0.0]}
    timeout_s: 1
  act: {rule: learn.act, bundle: $task, episodes: $episodes, steps: 5, width: 16, heads: 2}
  act_twin: {rule: evaluate.rollouts, bundle: $task, checkpoint: $act, trials: 2}
targets:
  default: [act_twin]
"""
SERVED = """
summary: The same policy, asked over the network.
inputs:
  task: task/try:task
nodes:
  policy: {rule: learn.served, bundle: $task}
  policy_twin: {rule: evaluate.rollouts, bundle: $task, checkpoint: $policy, trials: 2}
targets:
  default: [policy_twin]
"""
REAL = ("simulate.task=mujoco", "learn.act=torch", "evaluate.rollouts=mujoco", "learn.served=network")
FLAGS = ("--profile", "stub", *(word for backend in REAL for word in ("--backend", backend)))


@pytest.mark.slow
def test_a_policy_is_served_and_evaluated_over_the_network(space: Space) -> None:
    space.write("recipes/task/try.yaml", TASK)
    space.write("recipes/task/asked.yaml", SERVED)
    built = space.build("task/try", *FLAGS)
    assert built.code == 0, built.err[-3000:]
    server = space.start("serve", "task/try:act", "--port", "0", "--json", *FLAGS)
    assert server.stdout is not None
    try:
        stated = documents.read(server.stdout.readline())
        assert (stated["algorithm"], stated["task"], stated["horizon"]) == ("act", "Try", 20)
        assert len(stated["joints"]) == 23
        asked = space.build("task/asked", "--set", f"policy.address={stated['url']}", *FLAGS)
        assert asked.code == 0, asked.err[-3000:]
    finally:
        server.send_signal(signal.SIGINT)
        _, err = server.communicate(timeout=60)
    assert server.returncode == 0, err
    assert "Traceback" not in err
    here = got(space, "task/try:act_twin")
    there = got(space, "task/asked:policy_twin", "--set", f"policy.address={stated['url']}")
    assert here["items"] == there["items"]
    assert (here["algorithm"], there["algorithm"]) == ("act", "served")


def got(space: Space, node: str, *more: str) -> dict[str, Any]:
    """The trials of a node, as `dxb get` writes them."""
    done = space.dxb("get", node, "-o", "got", *FLAGS, *more)
    assert done.code == 0, done.err
    found: dict[str, Any] = json.loads((space.root / done.out.split()[0]).read_text())
    return found


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("say/words",), "DXB-U111"),
        (("say/words:start",), "DXB-U340"),
        (("say/words:start", "--host", "0.0.0.0"), "DXB-U342"),
        (("say/words:start", "--api-key", "NO_SUCH_VARIABLE"), "DXB-U342"),
    ],
)
def test_what_cannot_be_served_is_refused(words: tuple[str, ...], code: str, space: Space) -> None:
    assert space.build("say/words").code == 0
    done = space.dxb("serve", *words)
    assert done.code == 2
    assert f"error[{code}]" in done.err
