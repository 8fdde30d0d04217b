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

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import MachineError, RuleError
from dextera_build.policy.observation import DeployableObservation, Measurement, deployable
from dextera_build.sim.runtime.policies import load
from dextera_build.testing import RuleRunner
from tests import gantry, readers, task_bundles
from tests.policy import policies

pytestmark = pytest.mark.slow
BUNDLE = task_bundles.lift(reset=gantry.RESET)
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
    return gantry.demonstrations(BUNDLE, 4)


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


def observed(episode: Episode) -> list[DeployableObservation]:
    """What a policy would see in an episode."""
    fields = zip(episode.joints, episode.objects, episode.displacement, strict=True)
    return [deployable(Measurement(*each), episode.start.ctrl, episode.goal) for each in fields]


def test_act_of_lerobot_is_killed_goes_on_and_does_what_was_shown(
    runner: RuleRunner, shown: Episodes, tmp_path: Path
) -> None:
    options = {"steps": 60, "save_every": 10}
    killer = threading.Thread(target=kill_after_a_checkpoint, args=[tmp_path / "keep"], daemon=True)
    killer.start()
    with pytest.raises(RuleError, match=r"LeRobot's trainer failed \(signal 15\)"):
        learn(runner, shown, "act", ACT, **options)
    killer.join()
    made = learn(runner, shown, "act", ACT, **options)
    assert made.steps[0] == 1
    assert made.steps[-1] == 60
    assert np.all(np.diff(made.steps) > 0)
    assert made.curve[-10:].mean() < made.curve[:5].mean() / 2
    policy, one = load(policies.runner("lerobot"), made, BUNDLE), shown.in_order()[0][1]
    missed = []
    for row, seen in list(enumerate(observed(one)))[::10]:
        policy.reset()  # so that it predicts anew
        missed.append(np.abs(policy.act(seen) - one.action[row]).max())
    assert np.median(missed) < 0.25 * np.ptp(one.action, axis=0).max()
    found = runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=made, options={"trials": 1})
    assert (found.algorithm, len(found.items)) == ("outside", 1)


def test_diffusion_of_lerobot_acts_the_same_in_every_episode(
    runner: RuleRunner, shown: Episodes, tmp_path: Path
) -> None:
    made = learn(runner, shown, "diffusion", DIFFUSION, steps=20)
    lerobot = policies.runner("lerobot")
    policy = load(lerobot, made, BUNDLE)
    seen = observed(shown.in_order()[0][1])[:6]

    def acted() -> np.ndarray:
        policy.reset()
        return np.array([policy.act(each) for each in seen])

    first = acted()
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(acted(), first)
    (tmp_path / "envs" / "lerobot.lock").unlink()
    with pytest.raises(MachineError, match="the lock file"):
        load(lerobot, made, BUNDLE)
