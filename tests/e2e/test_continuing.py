"""`dxb run --real-time-chunking`: answers of a Diffusion Policy continue what a robot carries out, over DDS."""

from __future__ import annotations

import pytest

from tests.e2e.robots import NAMES, built, ended, ran, started
from tests.e2e.space import Space

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

RECIPE = """
summary: A small Diffusion Policy.
extends: task/try
nodes:
  shown: {rule: demonstrate.operate, backend: stub, bundle: $task, episodes: 4}
  diffusion:
    rule: learn.diffusion
    backend: torch
    bundle: $task
    episodes: $shown
    inputs: [joints]
    steps: 4
    batch: 4
    warm_up: 1
    width: 8
    levels: 2
    horizon: 8
    every: 4
    denoisings: 2
targets:
  default: [diffusion]
"""


@pytest.mark.slow
def test_answers_of_a_diffusion_policy_continue_what_is_carried_out(space: Space) -> None:
    built(space)
    space.write("recipes/task/denoised.yaml", RECIPE)
    done = space.build("task/denoised")
    assert done.code == 0, done.err[-3000:]
    chunking = "--real-time-chunking"
    other = space.dxb("run", "task/try", "--policy", "task/try:policy", chunking, *NAMES)
    assert (other.code, "DXB-B560" in other.err) == (1, True), other.err
    robot = started(space)
    try:
        code, told = ran(space, "continued.mcap", chunking, policy="task/denoised:diffusion")
    finally:
        heard = ended(robot)
    assert (code, told["reason"]) == (0, "not done within 4 s")
    assert 2 * told["steps"] == heard["commands"] == 40
    assert told["periods_without_a_step"] == 0
    assert told["answer_ms_p50"] > 0
    # Windows of 8 steps with 2 observed ones: a new answer after 4 of 7, or earlier.
    assert 0 <= told["age_ms_p99"] <= 1000 * 6 / 5
