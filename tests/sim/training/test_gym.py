"""Task bundles as Gymnasium environments."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_for_sb3

from dextera_build.artifacts.tasks.task import Reset
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.policy.terms import Sensor
from dextera_build.sim.runtime import privileged
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training import gym
from tests import episodes, factories, task_bundles

WIDE = Reset(position_m=0.03, yaw_rad=0.5, robot_rad=0.01)


@pytest.mark.parametrize("action", ["delta", "end_effector"])
def test_they_accept_it_with_every_kind_of_action(action):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        environment = gym.TaskEnv(task_bundles.lift(reset=WIDE), action=action)
        check_env(environment, skip_render_check=True)
        check_for_sb3(environment)


def test_the_task_says_which_kind_an_environment_takes():
    bundle = task_bundles.lift()
    told = bundle.model_copy(update={"task": bundle.task.model_copy(update={"action": "delta"})})
    assert gym.TaskEnv(bundle).actions.spec.kind == "joint"
    assert gym.TaskEnv(told).actions.spec.kind == "delta"
    assert gym.TaskEnv(told, action="joint").actions.spec.kind == "joint"


@pytest.mark.parametrize("privileged", [False, True])
@pytest.mark.parametrize("make", [task_bundles.lift, task_bundles.close])
def test_gymnasium_and_stable_baselines_accept_it(make, privileged):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # joint targets are radians, not -1 to 1
        for render_mode in (None, "rgb_array"):
            environment = gym.TaskEnv(make(reset=WIDE), privileged=privileged, render_mode=render_mode)
            check_env(environment, skip_render_check=render_mode is None)
            check_for_sb3(environment)
            environment.close()


def test_privileged_keys_are_there_only_when_asked_for():
    plain, told = (gym.TaskEnv(task_bundles.lift(), privileged=privileged) for privileged in (False, True))
    assert {name.split("/")[0] for name in plain.observation_space} == {"deployable"}
    assert set(plain.observation_space) < set(told.observation_space)
    extra = set(told.observation_space) - set(plain.observation_space)
    assert extra == {
        f"privileged/{name}"
        for name in (
            "contact",
            "joint_velocities",
            "object_velocities",
            "displacement_velocities",
            "hand_poses",
            "hand_velocities",
            "tip_poses",
            "tip_velocities",
            "points",
        )
    }


def test_a_seed_begins_the_episode_that_it_begins_everywhere():
    bundle = task_bundles.lift(reset=WIDE)
    seen, _ = gym.TaskEnv(bundle).reset(seed=11)
    plain = Environment(bundle)
    wanted = plain.reset(11)
    assert np.array_equal(seen["deployable/objects"], wanted["objects"])
    environment = gym.TaskEnv(bundle)
    given, _ = environment.reset(options={"start": plain.start})
    assert np.array_equal(given["deployable/objects"], wanted["objects"])
    first, second = environment.reset(seed=1), environment.reset()
    assert not np.array_equal(first[0]["deployable/objects"], second[0]["deployable/objects"])


def test_time_truncates_and_a_broken_action_terminates():
    environment = gym.TaskEnv(task_bundles.lift())
    environment.reset(seed=0)
    hold = environment.environment.previous_action
    for step in range(80):
        _, _, terminated, truncated, info = environment.step(hold)
        assert (terminated, truncated) == (False, step == 79)
    assert (info["success"], info["is_success"], info["reason"]) == (
        False,
        False,
        "not done within 4 s: the object is too low",
    )
    environment.reset(seed=0)
    seen, reward, terminated, truncated, info = environment.step(np.full(5, np.nan))
    assert (terminated, truncated, reward) == (True, False, 0.0)
    assert info["reason"] == "the action for `x` is not a finite number"
    assert all(np.isfinite(value).all() for value in seen.values())


def test_a_lift_earns_reward_and_terminates_as_a_success():
    environment = gym.TaskEnv(task_bundles.lift())
    environment.reset(seed=0)
    earned, steps = [], 0
    plan = [((0.3, 0.1, 0.1), 0.05, 18), ((0.3, 0.1, 0.0), 0.05, 8), ((0.3, 0.1, 0.0), 0.012, 6)]
    for place, fingers, periods in [*plan, ((0.3, 0.1, 0.15), 0.012, 40)]:
        total = 0.0
        for _ in range(periods):
            _, reward, terminated, truncated, info = environment.step(np.array([*place, fingers, fingers]))
            total, steps = total + reward, steps + 1
            if terminated or truncated:
                break
        earned.append(total)
    assert terminated
    assert not truncated
    assert info["is_success"]
    reach, down, hold, rise = earned
    assert reach > 0.2
    assert down > 0.1
    assert hold > 0.9
    assert rise > 8.5  # 4 for the way up and 5 for success
    assert steps < 72


def test_pictures_come_through_the_view_that_is_given():
    view = episodes.view(width=32, height=24)
    environment = gym.TaskEnv(task_bundles.lift(), views={"front": view}, render_mode="rgb_array", size=(80, 60))
    seen, _ = environment.reset(seed=0)
    assert seen["deployable/rgb/front"].shape == (24, 32, 3)
    assert seen["deployable/rgb/front"].std() > 1
    shown = environment.render()
    assert shown is not None
    assert shown.shape == (60, 80, 3)
    environment.close()


def test_a_render_mode_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="`render_mode` is `rgb_array` or None, not `human`"):
        gym.TaskEnv(task_bundles.lift(), render_mode="human")


def test_cameras_agree_on_where_the_table_is():
    views = {"front": episodes.view(48, 36), "other": episodes.view(32, 24)}
    aside = factories.placed(factories.look_at((0.7, -0.5, 0.7)), "camera")
    views["other"] = views["other"].model_copy(update={"camera_pose": aside})
    environment = gym.TaskEnv(task_bundles.lift(), views=views, pictures=("depth", "cloud"))
    seen, _ = environment.reset(seed=0)
    environment.close()
    assert environment.observation_space.contains(seen)
    assert not any(name.startswith("deployable/rgb") for name in seen)
    for name, view in views.items():
        depth, cloud = seen[f"deployable/depth/{name}"], seen[f"deployable/cloud/{name}"]
        assert np.array_equal(cloud[..., 2], depth)
        points = transforms.apply(view.camera_pose.matrix, cloud[depth > 0].astype(np.float64))
        on_table = np.abs(points[:, 2]) < 0.002
        assert on_table.mean() > 0.5
        assert points[:, 2].min() > -0.05


def test_privileged_values_full_of_nan_change_no_deployable_byte(monkeypatch):
    def episode(poisoned: bool) -> list[bytes]:
        environment = gym.TaskEnv(task_bundles.close(reset=WIDE), privileged=poisoned)
        if poisoned:
            nothing = {name: lambda worlds: np.full((1, 1), np.nan) for name in privileged.MEASURES}
            monkeypatch.setattr(privileged, "MEASURES", nothing)
        seen, _ = environment.reset(seed=5)
        found = [seen]
        for step in range(12):
            found.append(environment.step(environment.environment.previous_action + 0.01 * (step % 3))[0])
        return [row[name].tobytes() for row in found for name in sorted(row) if name.startswith("deployable/")]

    assert episode(True) == episode(False)


def test_an_episode_that_runs_again_is_measured_alike():
    sensors = {"objects": Sensor(rate_hz=10.0, delay_s=0.06, sigma=0.003), "joints": Sensor(sigma=0.001)}
    environment = gym.TaskEnv(task_bundles.lift(reset=WIDE), sensors=sensors)

    def episode(**how: object) -> list[np.ndarray]:
        first, _ = environment.reset(**how)
        hold = environment.environment.previous_action
        rows = [first, *(environment.step(hold + 0.01)[0] for _ in range(5))]
        return [row["deployable/objects"] for row in rows]

    first = episode(seed=2)
    start = environment.environment.start
    exact = environment.environment.measure().objects
    assert not np.allclose(first[-1], exact, atol=1e-4)
    episode(seed=3)
    assert np.array_equal(first, episode(options={"start": start}))


def test_pictures_and_sensors_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match="`pictures` are cloud, depth, rgb, not `rbg`"):
        gym.TaskEnv(task_bundles.lift(), pictures=("rbg",))
    with pytest.raises(RuleError, match="`contact` is privileged, so that no sensor measures it"):
        gym.TaskEnv(task_bundles.lift(), sensors={"contact": Sensor(sigma=0.1)})
