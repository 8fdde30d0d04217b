"""Several copies of a task at once, and tasks by name."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from dextera_build import envs
from dextera_build.artifacts.packed import pack
from dextera_build.artifacts.tasks.task import Reset
from dextera_build.errors import RuleError
from dextera_build.sim.runtime import starts
from dextera_build.sim.training.gym import TaskEnv
from dextera_build.sim.training.vector import TaskVectorEnv
from tests import task_bundles

WIDE = Reset(position_m=0.03, yaw_rad=0.5, robot_rad=0.01)


@pytest.mark.medium
def test_copies_step_as_each_would_alone_and_begin_anew():
    bundle = task_bundles.close(reset=WIDE)
    together = TaskVectorEnv(bundle, 3, threads=3)
    alone = [TaskEnv(bundle) for _ in range(3)]
    seen, _ = together.reset(seed=7)
    single = [each.reset(seed=7 + number)[0] for number, each in enumerate(alone)]
    random, over = np.random.default_rng(0), [False] * 3
    assert together.observation_space.contains(seen)
    for step in range(83):
        for name, values in seen.items():
            assert values.tobytes() == np.stack([row[name] for row in single]).tobytes(), (name, step)
        actions = np.stack([each.environment.previous_action for each in alone])
        actions = (actions + random.uniform(-0.03, 0.03, actions.shape)).astype(np.float32)
        seen, rewards, terminated, truncated, infos = together.step(actions)
        found = [(*alone[n].reset(), None) if over[n] else alone[n].step(actions[n]) for n in range(3)]
        single = [row[0] for row in found]
        if not any(over):
            assert rewards.tolist() == [row[1] for row in found]
            assert infos["success"].tolist() == [row[4]["success"] for row in found]
        over = (terminated | truncated).tolist()
        assert over == [step == 79] * 3
    together.close()


def test_a_copy_whose_next_start_cannot_be_drawn_begins_at_another(monkeypatch):
    together = TaskVectorEnv(task_bundles.close(reset=WIDE), 2)
    together.reset(seed=7)
    draw, asked = starts.draw, []

    def drawn(bundle, model, data, changed, seed, *more, **named):
        asked.append(seed)
        if len(asked) == 1:
            raise RuleError("no start without collisions was found", code="DXB-B211")
        return draw(bundle, model, data, changed, seed, *more, **named)

    monkeypatch.setattr(starts, "draw", drawn)
    actions = np.stack([each.previous_action for each in together.worlds.environments])
    actions[0, 0] = np.nan  # ends the episode of the first copy
    assert together.step(actions)[2].tolist() == [True, False]
    assert together.step(actions)[2].tolist() == [False, False]
    assert together.worlds.environments[0].start.seed == asked[1] == asked[0] + 1
    asked.clear()
    with pytest.raises(RuleError, match="no start"):
        together.reset(seed=7)
    together.close()


def test_copies_that_move_palms_step_as_each_would_alone():
    bundle = task_bundles.lift(reset=WIDE)
    together = TaskVectorEnv(bundle, 2, threads=2, action="end_effector")
    alone = [TaskEnv(bundle, action="end_effector") for _ in range(2)]
    together.reset(seed=7)
    for number, each in enumerate(alone):
        each.reset(seed=7 + number)
    space = together.single_action_space
    random = np.random.default_rng(0)
    for _ in range(10):
        actions = random.uniform(space.low, space.high, (2, *space.shape)).astype(np.float32)
        seen = together.step(actions)[0]["deployable/joints"]
        single = [each.step(action)[0]["deployable/joints"] for each, action in zip(alone, actions, strict=True)]
        assert seen.tobytes() == np.stack(single).tobytes()
    together.close()


def test_a_folder_of_bundles_has_names_for_gymnasium(tmp_path):
    (tmp_path / "LiftBox-GANTRY-v3.bundle").write_bytes(pack(task_bundles.lift()))
    (tmp_path / "task.bundle").write_bytes(b"has no name")
    assert envs.register_folder(tmp_path) == ["dxb/LiftBox-GANTRY-v3"]
    environment = gymnasium.make("dxb/LiftBox-GANTRY-v3", privileged=True)
    seen, _ = environment.reset(seed=3)
    assert environment.observation_space.contains(seen)
    assert environment.unwrapped.environment.task.name == "LiftBox"
    several = gymnasium.make_vec("dxb/LiftBox-GANTRY-v3", num_envs=2, vectorization_mode="vector_entry_point")
    assert isinstance(several, TaskVectorEnv)
    assert several.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert several.action_space.shape == (2, 5)
    several.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_own_vector_environments_take_it(tmp_path, mode):
    (tmp_path / "task.bundle").write_bytes(pack(task_bundles.lift(reset=WIDE)))
    envs.register("dxb/LiftBox-GANTRY-v4", tmp_path / "task.bundle")
    several = gymnasium.make_vec("dxb/LiftBox-GANTRY-v4", num_envs=2, vectorization_mode=mode)
    seen, _ = several.reset(seed=1)
    seen, rewards, *_ = several.step(several.action_space.sample())
    assert rewards.shape == (2,)
    assert seen["deployable/objects"].shape == (2, 2, 7)
    several.close()
