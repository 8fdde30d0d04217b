"""LeRobot's own trainer and policies, in the environment of LeRobot: trained, killed, resumed, and tried in MuJoCo."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import MachineError, RuleError
from dextera_build.policy.layout import gathered
from dextera_build.policy.observation import Measurement, deployable
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.policies import load
from dextera_build.sim.runtime.rollout import closed_loop
from dextera_build.testing import RuleRunner
from tests import gate, readers
from tests.policy import policies
from tests.rules.learn.test_in_mujoco import Demonstrator

pytestmark = pytest.mark.slow
BUNDLE = gate.bundle()
ACT = {
    "chunk_size": 10,
    "n_action_steps": 10,
    "dim_model": 32,
    "n_heads": 2,
    "dim_feedforward": 64,
    "n_encoder_layers": 1,
    "n_vae_encoder_layers": 1,
    "optimizer_lr": 0.001,
}
DIFFUSION = {
    "down_dims": [16, 32],
    "n_groups": 4,
    "horizon": 8,
    "n_action_steps": 4,
    "drop_n_last_frames": 3,
    "noise_scheduler_type": "DDIM",
    "num_inference_steps": 4,
    "optimizer_lr": 0.001,
}


@pytest.fixture(scope="module")
def shown() -> Episodes:
    environment = Environment(BUNDLE)
    made = [closed_loop(environment, Demonstrator(), environment.draw(seed)) for seed in range(1000, 1008)]
    return gathered(BUNDLE, {str(number): episode for number, episode in enumerate(made)}, {}, len(made))


@pytest.fixture
def runner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RuleRunner:
    """A project whose environment `lerobot` is LeRobot's."""
    readers.installed(tmp_path, "lerobot", "lerobot-0.4")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    (tmp_path / "scratch").mkdir()
    made_by = {"checkpoint": "learn.lerobot"}
    return RuleRunner(tmp_path / "scratch", project=tmp_path, keep=tmp_path / "keep", made_by=made_by)


def learn(runner: RuleRunner, shown: Episodes, kind: str, policy: dict[str, Any], **options: Any) -> Checkpoint:
    data = runner.run("demonstrate.lerobot", bundle=BUNDLE, episodes=shown)
    more = {"type": kind, "policy": policy, "batch": 32, "workers": 0} | options
    made = runner.run("learn.lerobot", backend="own", bundle=BUNDLE, data=data, options=more)
    assert isinstance(made, Checkpoint)
    return made


def kill_after_a_checkpoint(keep: Path) -> None:
    """Kill LeRobot's trainer as soon as it has saved a checkpoint."""
    while not (keep / "run" / "checkpoints" / "last").exists():
        time.sleep(0.05)
    for place in Path("/proc").glob("[0-9]*"):
        words = (place / "cmdline").read_bytes().split(b"\0") if (place / "cmdline").exists() else []
        if b"lerobot.scripts.lerobot_train" in words and any(str(keep).encode() in word for word in words):
            os.kill(int(place.name), signal.SIGTERM)


def test_act_of_lerobot_is_killed_goes_on_and_does_what_was_shown(
    runner: RuleRunner, shown: Episodes, tmp_path: Path
) -> None:
    options = {"steps": 300, "save_every": 20}
    killer = threading.Thread(target=kill_after_a_checkpoint, args=[tmp_path / "keep"], daemon=True)
    killer.start()
    with pytest.raises(RuleError, match=r"LeRobot's trainer failed \(signal 15\)"):
        learn(runner, shown, "act", ACT, **options)
    killer.join()
    made = learn(runner, shown, "act", ACT, **options)
    assert made.steps[0] <= 20
    assert made.steps[-1] == 300
    assert np.all(np.diff(made.steps) > 0)
    assert made.curve[-20:].mean() < made.curve[:20].mean() / 4
    found = runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=made, options={"trials": 3})
    assert found.successes >= 2, found.reasons


def test_diffusion_of_lerobot_acts_the_same_in_every_episode(
    runner: RuleRunner, shown: Episodes, tmp_path: Path
) -> None:
    made = learn(runner, shown, "diffusion", DIFFUSION, steps=20)
    lerobot = policies.runner("lerobot")
    policy = load(lerobot, made, BUNDLE)
    one = shown.in_order()[0][1]
    seen = [Measurement(*each) for each in zip(one.joints, one.objects, one.displacement, strict=True)][:6]

    def acted() -> np.ndarray:
        policy.reset()
        return np.array([policy.act(deployable(each, one.start.ctrl, one.goal)) for each in seen])

    first = acted()
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(acted(), first)
    (tmp_path / "envs" / "lerobot.lock").unlink()
    with pytest.raises(MachineError, match="the lock file"):
        load(lerobot, made, BUNDLE)
