"""A policy with two cameras from its recipe: filmed, trained before other backgrounds, tried, run on a robot."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.tasks.task import View
from dextera_build.formats.ros import reading
from dextera_build.policy.layout import gathered
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import closed_loop
from tests import factories, gate
from tests.e2e.robots import DOMAIN, STORED, built, ended, started, stored
from tests.e2e.space import Space
from tests.e2e.test_robot_tracker import task
from tests.rules.learn.test_in_mujoco import Demonstrator

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

RECIPE = """
summary: A policy that looks through two cameras.
inputs:
  task_file: data/gate.json
  episodes_file: data/episodes.json
  front_file: data/front.json
  above_file: data/above.json
nodes:
  task: {rule: demo.task, stored: $task_file, primitive: articulate, articulate: {joints_deg: {hinge: 0}}}
  episodes: {rule: demo.episodes, stored: $episodes_file}
  front: {rule: demo.view, stored: $front_file}
  above: {rule: demo.view, stored: $above_file}
  front_film: {rule: demonstrate.film, bundle: $task, episodes: $episodes, view: $front, camera: front}
  above_film: {rule: demonstrate.film, bundle: $task, episodes: $episodes, view: $above, camera: above}
  front_backdrop:
    {rule: demonstrate.backdrop, bundle: $task, episodes: $episodes, view: $front, camera: front, pictures: 4}
  above_pixels: {rule: demonstrate.unpack, film: $above_film}
  act:
    rule: learn.act
    bundle: $task
    episodes: $episodes
    films: {front: $front_film, above: $above_pixels}
    inputs: [joints, rgb]
    backdrops: {front: $front_backdrop}
    swap: 0.3
    steps: 200
    batch: 16
    width: 32
    heads: 2
    chunk: 5
    held_out: 0.0
  act_twin: {rule: evaluate.rollouts, bundle: $task, checkpoint: $act, views: {front: $front, above: $above}, trials: 5}
  blind: {rule: evaluate.rollouts, bundle: $task, checkpoint: $act, views: {front: $front}, trials: 5}
targets:
  default: [act_twin]
"""
VIEWS = ("--view", "front=task/seen:front", "--view", "above=task/seen:above")
NAMES = ("--domain", DOMAIN)


def project(space: Space) -> Space:
    """The project, with eight episodes of the task at 5 Hz."""
    built(space)
    bundle = task()
    environment = Environment(bundle)
    shown = [closed_loop(environment, Demonstrator(), environment.draw(seed)) for seed in range(1000, 1008)]
    episodes = gathered(bundle, {str(number): each for number, each in enumerate(shown)}, {}, len(shown))
    above = factories.placed(factories.look_at((0.3, -0.1, 0.9)), "camera")
    views = {"front": gate.view(), "above": View(camera=factories.camera(48, 48), camera_pose=above)}
    for name, value in {"gate": bundle, "episodes": episodes, **views}.items():
        space.write(f"data/{name}.json", stored(value))
    text = STORED.replace("NAME", "episodes").replace("KIND", "Episodes").replace("tasks.task", "tasks.episode")
    space.write("rules/demo/episodes.py", text.lstrip())
    space.write("recipes/task/seen.yaml", RECIPE)
    return space


@pytest.mark.slow
def test_a_policy_with_two_cameras_is_trained_tried_and_run(space: Space) -> None:
    project(space)
    done = space.build("task/seen")
    assert done.code == 0, done.err[-3000:]
    refused = space.build("task/seen:blind")
    assert refused.code != 0
    assert "no camera `above`" in refused.err
    assert "the policy looks at 48 x 48 px, the bundle's cameras are front" in refused.err
    robot = started(space, *VIEWS, *NAMES, target="task/seen", names=())
    try:
        command = ("run", "task/seen", "--policy", "task/seen:act", "--json", "--limit", "10", *NAMES)
        alone = space.dxb(*command, "--view", "task/seen:front")
        assert alone.code != 0
        assert "no camera `above`, no camera `front`" in alone.err
        twice = space.dxb(*command, "--view", "task/seen:front", "--view", "task/seen:above")
        assert (twice.code, "DXB-U353" in twice.err) == (2, True)
        ran = space.dxb(*command, *VIEWS, "--out", "seen.mcap")
    finally:
        heard = ended(robot)
    assert ran.out, ran.err
    assert ran.document["steps"] > 5, ran.err
    assert heard["commands_after_stop"] == 0
    with (space.root / "seen.mcap").open("rb") as stream:
        counts = {each.topic: each.count for each in reading.index(stream, "seen.mcap")[0]}
    assert min(counts[f"/{name}/color/image_raw/compressed"] for name in ("front", "above")) > 5
