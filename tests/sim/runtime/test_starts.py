"""Starts and dynamics: drawn by seed, within what the twin claims, applied to the model itself."""

from __future__ import annotations

import contextlib
from statistics import NormalDist

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import Reset
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, quaternions
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.primitives.push.primitive import PushGoal
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.dynamics import Dynamics
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.strata import Stratum
from tests import task_bundles

WIDE = Reset(position_m=0.03, yaw_rad=0.5, clutter_m=0.01, robot_rad=0.01, joint_rad=0.1, dynamics=1.0)


@pytest.fixture(scope="module")
def drawn() -> list[starts.Start]:
    environment = Environment(task_bundles.close(reset=WIDE))
    return [environment.draw(seed) for seed in range(60)]


def test_a_seed_decides_a_start_whatever_was_drawn_before(drawn):
    environment = Environment(task_bundles.close(reset=WIDE))
    for seed in (59, 0, 17):
        again = environment.draw(seed)
        assert again.model_dump_json(exclude={"qpos", "ctrl"}) == drawn[seed].model_dump_json(exclude={"qpos", "ctrl"})
        assert again.qpos.tobytes() == drawn[seed].qpos.tobytes()
    assert len({start.qpos.tobytes() for start in drawn}) == len(drawn)


def test_starts_fill_the_ranges_and_stay_inside_them(drawn):
    bundle = task_bundles.close(reset=WIDE)
    qpos = np.array([start.qpos for start in drawn])
    box = qpos[:, :2] - bundle.objects["box"].pose.matrix[:2, 3]
    case = qpos[:, 7:9] - bundle.objects["case"].pose.matrix[:2, 3]
    lid, robot = qpos[:, 14] - 1.5, qpos[:, 15:18]
    for values, reach in ((box, 0.01), (case, 0.03), (lid, 0.1), (robot, 0.01)):
        assert np.abs(values).max() <= reach + 1e-12
        assert np.abs(values).max() > 0.8 * reach
        assert abs(values.mean()) < 0.35 * reach
    home = bundle.objects["case"].pose.matrix[:3, :3]
    turned = [np.arctan2(*(home.T @ quaternions.to_matrix(row[10:14]))[[1, 0], 0]) for row in qpos]
    assert 0.4 < np.abs(turned).max() <= 0.5
    assert np.array_equal(qpos[:, 15:], [start.ctrl for start in drawn])


def test_dynamics_are_drawn_within_what_the_twin_claims(drawn):
    for name in ("box", "case"):
        mass = np.array([start.mass_scale[name] for start in drawn])
        friction = np.array([start.friction[name] for start in drawn])
        assert mass.min() >= 0.7
        assert mass.max() <= 1.4
        assert np.ptp(mass) > 0.5
        assert np.abs(friction - 0.8).max() <= 1.645 * 0.1 + 1e-12
        assert friction.std() > 0.04
    assert np.ptp([start.gain_scale for start in drawn]) > 0.1


def test_without_dynamics_the_estimates_stay():
    environment = Environment(task_bundles.lift())
    start = environment.draw(4)
    assert set(start.mass_scale.values()) == {1.0}
    assert set(start.friction.values()) == {0.8}
    assert start.gain_scale == 1.0


def test_a_share_of_the_ranges_is_the_same_draw_nearer_to_the_photograph():
    environment = Environment(task_bundles.close(reset=WIDE.model_copy(update={"dynamics": 0.0})))
    photographed = environment.start.qpos
    for seed in range(3):
        offsets = []
        for share in (1.0, 0.5, 0.0):
            environment.reset(seed, share=share)
            offsets.append(environment.start.qpos - photographed)
        places = [*range(3), *range(7, 10), 14]
        assert np.abs(offsets[0][places]).max() > 1e-3
        assert np.allclose(offsets[0][places], 2.0 * offsets[1][places], atol=1e-8)
        assert np.allclose(offsets[2], 0.0, atol=1e-8)


def test_no_start_begins_in_a_collision():
    # The box would often be drawn into a post beside it.
    pose = task_bundles.WORLD_FROM_BASE
    post = pose[:3, :3] @ [0.3, 0.15, 0.0] + pose[:3, 3]
    extra = f'<geom type="cylinder" size="0.02 0.1" pos="{post[0]} {post[1]} 0.1"/>'
    environment = Environment(task_bundles.lift(extra=extra, reset=Reset(position_m=0.05)))
    for seed in range(20):
        environment.reset(seed)
        assert environment.data.ncon == 0 or environment.data.contact.dist.min() > -starts.TOUCH_M


def test_no_start_stands_beside_the_support():
    environment = Environment(task_bundles.lift(reset=Reset(position_m=0.6)))
    support = environment.model.geom("static_support")
    for seed in range(20):
        environment.reset(seed)
        local = environment.data.body("box").xpos[:2] - support.pos[:2]
        assert (np.abs(local) <= support.size[:2]).all()


def test_a_task_that_is_too_crowded_says_so():
    pose = task_bundles.WORLD_FROM_BASE
    place = pose[:3, :3] @ [*task_bundles.BOX_M, 0.0] + pose[:3, 3]
    extra = f'<geom type="cylinder" size="0.05 0.1" pos="{place[0]} {place[1]} 0.1"/>'
    environment = Environment(task_bundles.lift(extra=extra))
    with pytest.raises(RuleError, match="no start of `LiftBox` without collisions was found") as caught:
        environment.reset(0)
    assert caught.value.code == "DXB-B220"
    assert caught.value.facts == {
        "draws": "200, none accepted",
        "collisions": "box and the static scene (200x)",
        "ranges": "none",
    }
    assert caught.value.hint == "make the ranges of `reset` smaller"


def test_a_start_beside_the_support_and_one_at_the_goal_say_so():
    far = Environment(task_bundles.lift(reset=Reset(position_m=5000.0)))
    with pytest.raises(RuleError, match="no start of `LiftBox` with all objects on the support was found") as caught:
        far.reset(0)
    assert caught.value.facts["off the support"].startswith("box (")
    assert caught.value.facts["ranges"] == "position_m 5000"
    bundle = task_bundles.lift()
    x, y = bundle.objects["box"].pose.matrix[:2, 3].tolist()
    near = Tolerance(position_m=0.05, rotation_rad=3.0)
    goal = PushGoal(place_m=(x, y), yaw_rad=None, upright=(1.0, 0.0, 0.0, 0.0), tolerance=near)
    task = bundle.task.model_copy(update={"goal": goal})
    reached = Environment(bundle.model_copy(update={"task": task}))
    with pytest.raises(RuleError, match="no start of `LiftBox` away from its goal was found") as caught:
        reached.reset(0)
    assert caught.value.facts["goal reached at once"] == "200x"
    assert caught.value.hint == "choose a goal farther from the photographed place of the object"


def test_dynamics_are_applied_to_the_model_s_own_values():
    environment = Environment(task_bundles.lift())
    model, data = environment.model, environment.data
    own = model.body_mass.copy(), model.body_inertia.copy(), model.actuator_gainprm.copy()
    box, case, lid = (model.body(name).id for name in ("box", "case", "case_lid"))
    dynamics = Dynamics(environment.bundle, model)
    start = environment.start.model_copy(
        update={"mass_scale": {"box": 2.0, "case": 0.5}, "friction": {"box": 0.3, "case": 0.9}, "gain_scale": 1.1}
    )
    for _ in range(3):
        dynamics.apply(start, data)
        assert model.body_mass[box] == pytest.approx(2.0 * own[0][box])
        assert model.body_mass[[case, lid]] == pytest.approx(0.5 * own[0][[case, lid]])
        assert model.body_inertia[box] == pytest.approx(2.0 * own[1][box])
        assert model.actuator_gainprm[:, 0] == pytest.approx(1.1 * own[2][:, 0])
        assert model.actuator_biasprm[:, 1] == pytest.approx(-1.1 * own[2][:, 0])
        assert set(model.geom_friction[model.geom_bodyid == box][:, 0]) == {0.3}
        assert set(model.geom_friction[np.isin(model.geom_bodyid, [case, lid])][:, 0]) == {0.9}
    environment.reset(0)
    assert np.array_equal(model.body_mass, own[0])
    assert np.array_equal(model.actuator_gainprm, own[2])


def test_a_heavier_world_is_heavier_in_the_simulation():
    environment = Environment(task_bundles.lift())
    start = environment.start
    environment.begin(start.model_copy(update={"mass_scale": {"box": 3.0, "case": 1.0}}))
    assert environment.model.body("box").subtreemass[0] == pytest.approx(0.3)
    environment.begin(start)
    assert environment.model.body("box").subtreemass[0] == pytest.approx(0.1)


def test_a_less_certain_pose_is_drawn_from_a_wider_range():
    environment = Environment(task_bundles.close(reset=Reset(dynamics=1.0)))
    deviations = [_pose_spread(environment, sigma) for sigma in (0.0, 0.0005, 0.002)]
    assert np.allclose(deviations[0], 0.0, atol=1e-12)
    for found, sigma in zip(deviations[1:], (0.0005, 0.002), strict=True):
        assert np.allclose(found[:2], sigma, rtol=0.25)
        assert found[2] == pytest.approx(0.0, abs=1e-12)


def test_errors_of_poses_are_drawn_in_a_twin_only_and_not_without_dynamics():
    environment = Environment(task_bundles.close(reset=Reset(dynamics=0.0)))
    assert np.allclose(_pose_spread(environment, 0.002), 0.0, atol=1e-12)
    environment = Environment(task_bundles.close(reset=Reset(dynamics=1.0)))
    assert np.allclose(_pose_spread(environment, 0.002, kind="reference"), 0.0, atol=1e-12)


def _pose_spread(environment, sigma, kind="twin"):
    """Standard deviation of the box's start, (3,) [m], with `sigma` [m and rad] in all of its pose."""
    box = environment.bundle.objects["box"]
    pose = box.pose.model_copy(update={"covariance": np.eye(6) * sigma**2})
    objects = {**environment.bundle.objects, "box": box.model_copy(update={"pose": pose})}
    other = Environment(environment.bundle.model_copy(update={"objects": objects, "kind": kind}))
    return np.std([other.draw(seed).qpos[:3] for seed in range(100)], axis=0)


def _uncertain(scale_sigma: float, dynamics: float = 1.0, kind: str = "twin") -> Environment:
    bundle = task_bundles.close(reset=Reset(dynamics=dynamics))
    box = bundle.objects["box"].model_copy(update={"scale_sigma": scale_sigma})
    return Environment(bundle.model_copy(update={"objects": {**bundle.objects, "box": box}, "kind": kind}))


def _sizes(environment: Environment) -> np.ndarray:
    """Log sizes of the box, which stands on the support at every size."""
    drawn = [environment.draw(seed) for seed in range(60)]
    for start in drawn:
        environment.begin(start)
        size = start.size_scale["box"]
        half = environment.model.geom_size[environment.model.body("box").geomadr[0]]
        assert half == pytest.approx(task_bundles.HALF_M * size)
        assert start.qpos[2] == pytest.approx(environment.bundle.objects["box"].pose.matrix[2, 3] * size)
        assert start.size_scale["case"] == 1.0
    return np.log([start.size_scale["box"] for start in drawn])


@pytest.mark.medium
def test_a_less_certain_scale_is_drawn_from_a_wider_range():
    for sigma in (0.01, 0.05):
        sizes = _sizes(_uncertain(sigma))
        assert np.abs(sizes).max() <= 1.645 * sigma
        assert sizes.std() == pytest.approx(0.85 * sigma, rel=0.2)
    assert np.abs(_sizes(_uncertain(0.05, dynamics=0.5))).max() <= 0.5 * 1.645 * 0.05
    for still in (_uncertain(0.05, dynamics=0.0), _uncertain(0.05, kind="reference")):
        assert not _sizes(still).any()


def test_a_draw_leaves_the_running_episode_as_it_is():
    environment = _uncertain(0.05)
    environment.reset(1)
    before = environment.model.geom_size.copy()
    first = environment.draw(2)
    assert np.array_equal(environment.model.geom_size, before)
    assert environment.draw(2).qpos.tobytes() == first.qpos.tobytes()
    environment.reset(3)
    assert environment.draw(2).qpos.tobytes() == first.qpos.tobytes()
    assert environment.draw(2).size_scale == first.size_scale


def test_inertia_follows_size_and_mass():
    environment = _uncertain(0.05)
    box = environment.model.body("box").id
    mass, inertia = environment.model.body_mass[box], environment.model.body_inertia[box].copy()
    dynamics = {"mass_scale": {"box": 2.0, "case": 1.0}, "size_scale": {"box": 1.1}}
    environment.begin(environment.start.model_copy(update=dynamics))
    assert environment.model.body_mass[box] == pytest.approx(2.0 * mass)
    assert environment.model.body_inertia[box] == pytest.approx(2.0 * 1.1**2 * inertia)


MIXED = np.random.default_rng(3).normal(size=(6, 6)) * [0.002, 0.001, 0.003, 0.004, 0.001, 0.002]
"""Square root (6, 6) of the covariance of a base, all of whose numbers depend on one another."""


def _standing(covariance: np.ndarray | None = MIXED @ MIXED.T, dynamics: float = 1.0, kind: str = "twin"):
    """A task whose base is known to `covariance`."""
    bundle = task_bundles.close(reset=WIDE.model_copy(update={"dynamics": dynamics}))
    base = bundle.base_pose.model_copy(update={"covariance": covariance})
    return Environment(bundle.model_copy(update={"base_pose": base, "kind": kind}))


@pytest.mark.medium
def test_errors_of_the_base_spread_as_the_covariance_of_its_pose_says():
    environment, half = _standing(), _standing(dynamics=0.5)
    errors = np.array([environment.draw(seed).base_error for seed in range(400)])
    white = np.linalg.solve(MIXED, errors.T)
    assert np.abs(white.mean(axis=1)).max() < 0.2
    assert np.cov(white) == pytest.approx(np.eye(6), abs=0.2)
    assert np.allclose([half.draw(seed).base_error for seed in range(5)], 0.5 * errors[:5])


def test_a_series_fills_the_errors_of_the_base_evenly():
    sigmas = np.array([0.001, 0.002, 0.003, 0.004, 0.005, 0.006])
    environment = _standing(np.diag(sigmas**2))
    errors = [environment.draw(seed, Stratum(4, seed, 16)).base_error for seed in range(16)]
    for column in (np.array(errors) / sigmas).T:
        assert sorted(int(16 * NormalDist().cdf(value)) for value in column) == list(range(16))


def test_the_base_has_an_error_in_a_twin_only_and_not_without_a_covariance_or_dynamics():
    plain = _standing(None).draw(4)
    for environment in (_standing(None), _standing(dynamics=0.0), _standing(kind="reference")):
        assert environment.draw(4).base_error == (0.0,) * 6
    # All else is drawn as before there were errors of the base.
    start = _standing().draw(4)
    assert any(start.base_error)
    changed = start.model_copy(update={"base_error": plain.base_error})
    assert changed.model_dump_json(exclude={"qpos", "ctrl"}) == plain.model_dump_json(exclude={"qpos", "ctrl"})
    assert start.qpos.tobytes() == plain.qpos.tobytes()


def test_the_robot_stands_where_its_start_says_and_back_at_the_next_one():
    environment = _standing()
    model, data, photographed = environment.model, environment.data, environment.start
    own = model.body_pos.copy(), model.body_quat.copy()
    for seed in (1, 2, 1):
        environment.reset(seed)
        wanted = lie.retract(environment.bundle.base_pose.matrix, environment.start.base_error)
        assert np.allclose(data.body("robot/base").xpos, wanted[:3, 3])
        assert np.allclose(data.body("robot/base").xmat.reshape(3, 3), wanted[:3, :3])
        environment.draw(9)
        assert np.allclose(model.body("robot/base").pos, wanted[:3, 3])
    environment.begin(photographed)
    assert np.array_equal(model.body_pos, own[0])
    assert np.array_equal(model.body_quat, own[1])


def test_no_start_begins_with_the_hand_of_a_lower_base_in_the_table():
    # The fingertips of the gantry are 10 mm above the table.
    bundle = task_bundles.close(reset=Reset(dynamics=1.0))
    base = bundle.base_pose.model_copy(update={"covariance": np.diag([0.0, 0.0, 0.02**2, 0.0, 0.0, 0.0])})
    environment = Environment(bundle.model_copy(update={"base_pose": base}))
    heights = []
    for seed in range(6):
        with contextlib.suppress(RuleError):
            environment.reset(seed)
            heights.append(environment.start.base_error[2])
    assert 0 < len(heights) < 6
    assert min(heights) > -0.01 - starts.TOUCH_M
