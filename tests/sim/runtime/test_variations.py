"""What is drawn beside poses and masses: evenly over a series, kept with the start, and the same again."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.packed import pack, unpack
from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import Reset, View
from dextera_build.sim.primitives.articulate.primitive import ArticulateGoal
from dextera_build.sim.runtime import variations
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.strata import Strata, Stratum
from dextera_build.sim.training.gym import TaskEnv
from tests import episodes, factories, task_bundles

WIDE = Reset(position_m=0.03, yaw_rad=0.3, joint_rad=0.1, dynamics=1.0, joints=1.0, goal_rad=0.2, visual=1.0)


def test_a_series_fills_every_range_evenly_and_in_another_order():
    count = 16
    made = [Strata(Stratum(3, index, count), np.random.default_rng(index)) for index in range(count)]
    numbers = np.array([[draws.uniform(0.0, 1.0) for _ in range(4)] for draws in made])
    cells = np.floor(numbers * count).astype(int)
    for column in cells.T:
        assert sorted(column) == list(range(count))
    assert not np.array_equal(cells[:, 0], cells[:, 1])
    with pytest.raises(ValueError, match="episode 16 is not one of a series of 16"):
        Stratum(3, 16, 16)


def test_starts_of_a_series_spread_more_evenly_than_those_of_seeds():
    environment = Environment(task_bundles.close(reset=ranges(yaw_rad=0.0)))
    home = environment.bundle.objects["case"].pose.matrix[0, 3]

    def worst(starts: list[Start]) -> float:
        """Largest gap between neighbours and ends, over that of an even spread."""
        places = np.sort([start.qpos[7] - home for start in starts])
        return float(np.diff([-0.03, *places, 0.03]).max() / (0.06 / len(starts)))

    series = [environment.draw(seed, Stratum(1, seed, 24)) for seed in range(24)]
    assert worst(series) < 2.0 < worst([environment.draw(seed) for seed in range(24)])
    lid = np.sort([start.variation.damping["case"] for start in series])
    assert np.array_equal(np.floor((np.log(lid) / 0.5 + 1.0) / 2.0 * 24), np.arange(24))


def ranges(**changes: float) -> Reset:
    return WIDE.model_copy(update=changes)


def test_a_task_with_more_to_vary_has_the_same_places_and_masses():
    plain = Environment(task_bundles.close(reset=ranges(joints=0.0, goal_rad=0.0, visual=0.0)))
    varied = Environment(task_bundles.close(reset=WIDE))
    one, other = plain.draw(5), varied.draw(5)
    assert one.qpos.tobytes() == other.qpos.tobytes()
    assert one.mass_scale == other.mass_scale
    assert one.variation == type(one.variation)()
    assert other.variation != one.variation


def test_joints_are_damped_as_the_start_says_and_never_twice():
    environment = Environment(task_bundles.close(reset=WIDE))
    model = environment.model
    lid = model.joint("case_lid_hinge").dofadr[0]
    arm = model.joint("robot/x").dofadr[0]
    own = np.array([0.02, 20.0])
    for seed in (1, 2, 1):
        environment.reset(seed)
        factors = environment.start.variation
        assert model.dof_damping[[lid, arm]] == pytest.approx(own * [factors.damping["case"], factors.damping["robot"]])
        assert model.dof_frictionloss[lid] == pytest.approx(0.05 * factors.joint_friction["case"])
        assert 0.6 < factors.damping["case"] < 1.65


def test_the_goal_of_an_episode_is_what_is_seen_and_judged():
    environment = Environment(task_bundles.close(goal=1.0, reset=WIDE))
    seen = environment.reset(4)
    goal = environment.primitive.goal
    assert isinstance(goal, ArticulateGoal)
    drawn = goal.joints["case_lid_hinge"]
    assert 0.8 <= drawn <= 1.2
    assert drawn != 1.0
    assert seen["goal"] == pytest.approx([drawn])
    assert environment.judge.task.goal.model_dump() == goal.model_dump()
    environment.begin(environment.start.model_copy(update={"variation": type(environment.start.variation)()}))
    assert environment.task.goal == environment.bundle.task.goal


def test_an_episode_with_all_of_it_runs_again_bit_for_bit_from_its_stored_start():
    view = episodes.view(32, 24)
    covariance = np.diag([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4])
    pose = factories.placed(view.camera_pose.matrix, "camera").model_copy(update={"covariance": covariance})
    views = {"front": view.model_copy(update={"camera_pose": pose})}
    made = TaskEnv(task_bundles.close(reset=WIDE), views=views, pictures=("rgb", "depth"))

    def episode(**how: object) -> list[bytes]:
        seen, _ = made.reset(**how)
        rows = [seen, *(made.step(made.environment.previous_action + 0.01)[0] for _ in range(3))]
        return [row[name].tobytes() for row in rows for name in sorted(row)]

    first = episode(seed=8, options={"stratum": Stratum(2, 1, 4)})
    start = unpack(Start, pack(made.environment.start))
    errors = variations.seen(made.environment.bundle, start, views).cameras["front"]
    assert 0.001 < np.abs(errors).max() < 0.05
    assert start.variation.exposure != 1.0
    assert episode(seed=9) != first
    assert episode(options={"start": start}) == first
    made.close()


def test_an_error_of_one_calibration_is_drawn_once():
    """The photograph's camera stays with the objects that it saw where the base is off; another has its own error."""
    environment = Environment(task_bundles.close(reset=WIDE))
    plain = episodes.view(32, 24)
    pose = plain.camera_pose.model_copy(update={"covariance": np.eye(6) * 1e-4})
    apart = plain.model_copy(update={"camera_pose": pose})
    views: dict[str, View] = {"own": apart.model_copy(update={"photographed": True}), "apart": apart, "exact": plain}
    start = environment.draw(8)
    before = variations.seen(environment.bundle, start, views).cameras
    assert before.keys() == {"own", "apart"}
    off = start.model_copy(update={"base_error": (0.001, 0.0, 0.0, 0.0, 0.0, 0.0)})
    assert variations.seen(environment.bundle, off, views).cameras == {"apart": before["apart"]}
