"""Imitation learning in MuJoCo: demonstrations, a training and trials of a task of one joint, none of them replaced."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import View
from dextera_build.errors import RuleError
from dextera_build.policy.layout import gathered
from dextera_build.policy.observation import DeployableObservation
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import closed_loop
from dextera_build.testing import RuleRunner
from tests import factories, gate

AHEAD_RAD = 0.08
"""How far the demonstrator's targets lead the joint, which makes its speed."""
BUNDLE = gate.bundle()


class Demonstrator:
    """Turns the arm, and with it the flap, at an even speed until the flap is where it shall be."""

    def reset(self) -> None:
        """Nothing is remembered."""

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """The joint target [rad]."""
        return np.minimum(observation["joints"] + AHEAD_RAD, gate.target(gate.PUSHES))


@pytest.fixture(scope="module")
def shown() -> Episodes:
    environment = Environment(BUNDLE)
    made = [closed_loop(environment, Demonstrator(), environment.draw(seed)) for seed in range(1000, 1008)]
    assert all(episode.success for episode in made)
    assert np.mean([np.ptp(episode.action) for episode in made]) > 5 * AHEAD_RAD, "they move"
    return gathered(BUNDLE, {str(number): episode for number, episode in enumerate(made)}, {}, len(made))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "options"),
    [
        ("learn.act", {"width": 32, "heads": 2, "chunk": 10}),
        ("learn.act", {"width": 32, "heads": 2, "chunk": 10, "every": 10}),
        ("learn.bc_rnn", {"hidden": 32}),
        ("learn.diffusion", {"network": "transformer", "width": 32, "layers": 1, "heads": 2}),
        ("learn.diffusion", {"width": 16, "levels": 2, "horizon": 8, "every": 4}),
    ],
)
def test_a_policy_does_what_was_shown(tmp_path: Path, shown: Episodes, rule: str, options: dict[str, Any]) -> None:
    runner = RuleRunner(tmp_path, made_by={"checkpoint": rule})
    more = {"steps": 400, "batch": 32, "warm_up": 50, "held_out": 0.0}
    made = runner.run(rule, backend="torch", bundle=BUNDLE, episodes=shown, options=more | options)
    found = runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=made, options={"trials": 10})
    assert found.algorithm == made.contract.algorithm
    assert found.successes >= 6, found.reasons


@pytest.mark.slow
@pytest.mark.parametrize("name", ["depth", "cloud"])
def test_a_policy_on_depth_or_points_does_what_was_filmed(tmp_path: Path, shown: Episodes, name: str) -> None:
    runner = RuleRunner(tmp_path, made_by={"checkpoint": "learn.act"})
    seen = {"bundle": BUNDLE, "view": gate.view()}
    film = runner.run("demonstrate.film", episodes=shown, options={"depth": True}, **seen)
    more = {"steps": 400, "batch": 32, "warm_up": 50, "held_out": 0.0, "width": 32, "heads": 2, "chunk": 10}
    options = {**more, "inputs": ("joints", name)}
    made = runner.run("learn.act", backend="torch", bundle=BUNDLE, episodes=shown, film=film, options=options)
    found = runner.run("evaluate.rollouts", checkpoint=made, options={"trials": 10}, **seen)
    assert found.successes >= 6, found.reasons


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "options"),
    [
        ("learn.act", {"width": 32, "heads": 2, "chunk": 10}),
        ("learn.bc_rnn", {"hidden": 32}),
        ("learn.diffusion", {"width": 16, "levels": 2, "horizon": 8, "every": 4, "steps": 800}),
    ],
)
def test_a_policy_with_two_cameras_does_what_they_filmed(
    tmp_path: Path, shown: Episodes, rule: str, options: dict[str, Any]
) -> None:
    runner = RuleRunner(tmp_path, made_by={"checkpoint": rule})
    above = factories.placed(factories.look_at((0.3, -0.1, 0.9)), "camera")
    cameras = {"front": gate.view(), "above": View(camera=factories.camera(48, 48), camera_pose=above)}
    pixels = {}
    for name, view in cameras.items():
        seen = {"bundle": BUNDLE, "episodes": shown, "view": view}
        film = runner.run("demonstrate.film", options={"camera": name}, **seen)
        pixels[name] = runner.run("demonstrate.unpack", film=film)
    films, views = Collection[Pixels](items=pixels), Collection[View](items=cameras)
    more = {"steps": 400, "batch": 32, "warm_up": 50, "held_out": 0.0, "inputs": ("joints", "rgb")}
    made = runner.run(rule, backend="torch", bundle=BUNDLE, episodes=shown, films=films, options=more | options)
    assert [channel.shape for channel in made.contract.seen] == [(48, 48, 3), (48, 64, 3)]
    found = runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=made, views=views, options={"trials": 10})
    assert found.successes >= 6, found.reasons
    with pytest.raises(RuleError, match="no camera `above`, no camera `front`"):
        runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=made, view=gate.view(), options={"trials": 1})


@pytest.mark.slow
def test_the_snapshots_of_a_training_are_tried_in_the_twin(tmp_path: Path, shown: Episodes) -> None:
    runner = RuleRunner(tmp_path, made_by={"checkpoint": "learn.act"})
    more = {"steps": 400, "batch": 32, "warm_up": 50, "held_out": 0.0, "width": 32, "heads": 2, "chunk": 10}
    options = {**more, "average": 0.99, "snapshot_every": 20}
    made = runner.run("learn.act", backend="torch", bundle=BUNDLE, episodes=shown, options=options)
    kept = {step: made.snapshots[step] for step in ("20", "200")}
    made = made.model_copy(update={"snapshots": kept})
    given = {"bundle": BUNDLE, "checkpoint": made}
    tried: Checkpoint = runner.run("evaluate.early", options={"trials": 5}, **given)
    assert tried.early is not None
    assert tried.early.steps == (20, 200, 400)
    assert tried.early.successes[2] > 3
    assert len(runner.outcome.previews) == 1
    assert (tried.weights, tried.early.chosen, tried.snapshots) == (made.weights, 400, {})
    best: Checkpoint = runner.run("evaluate.early", options={"trials": 5, "choose": "best"}, **given)
    assert best.early is not None
    assert best.early.successes == tried.early.successes
    assert best.weights == {200: kept["200"], 400: made.weights}[best.early.chosen]
    assert runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=best, options={"trials": 5}).successes > 2
