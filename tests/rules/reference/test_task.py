"""reference.task: true things under the twin's names and frames, and what cannot be matched."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.sim.worlds import settle
from dextera_build.testing import RuleRunner
from tests import factories, reference_tasks
from tests.reference_tasks import TWIN_FROM_TRUTH, corners_of, opened, pose_of

THINGS = {"notebook": "laptop", "cup": "mug", "red_box": "carton"}
LID = "notebook_lid_hinge"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    made: World = RuleRunner(tmp_path_factory.mktemp("world")).run("reference.world", options=reference_tasks.WORLD)
    return made


@pytest.fixture(scope="module")
def twin(world: World) -> TaskBundle:
    return reference_tasks.bundle(reference_tasks.assets(world))


def build(folder: Path, twin: TaskBundle, world: World, **options: Any) -> TaskBundle:
    backend = options.pop("backend", "mujoco")
    made: TaskBundle = RuleRunner(folder).run(
        "reference.task",
        backend=backend,
        options=options,
        bundle=twin,
        world=world,
        robot=options.pop("robot", reference_tasks.robot()),
    )
    return made


@pytest.fixture(scope="module")
def true(world: World, twin: TaskBundle, tmp_path_factory: pytest.TempPathFactory) -> TaskBundle:
    return build(tmp_path_factory.mktemp("reference"), twin, world)


@pytest.mark.medium
def test_names_joints_and_their_order_are_the_twins(twin: TaskBundle, true: TaskBundle) -> None:
    (before, _), (after, _) = opened(twin), opened(true)
    for kind, count in (("body", before.nbody), ("joint", before.njnt), ("actuator", before.nu)):
        assert [getattr(after, kind)(n).name for n in range(count)] == [
            getattr(before, kind)(n).name for n in range(count)
        ]
    assert (after.nq, after.nv, after.nu) == (before.nq, before.nv, before.nu)
    np.testing.assert_array_equal(after.jnt_qposadr, before.jnt_qposadr)
    assert list(true.objects) == list(twin.objects)
    assert [thing.joints for thing in true.objects.values()] == [thing.joints for thing in twin.objects.values()]
    assert true.task == twin.task
    assert true.kind == "reference"


def test_every_frame_is_the_twins_in_the_photograph(twin: TaskBundle, true: TaskBundle) -> None:
    (model, before), (_, after) = opened(twin), opened(true)
    for number in range(1, model.nbody):
        name = model.body(number).name
        np.testing.assert_allclose(pose_of(after, name), pose_of(before, name), atol=2e-5, err_msg=name)


def test_every_true_surface_is_where_the_world_has_it(world: World, true: TaskBundle) -> None:
    model, data = opened(true)
    for body, name in THINGS.items():
        thing = world.objects[name]
        for part_name, part in thing.parts.items():
            owner = f"{body}_lid" if part_name == "lid" else body
            found = corners_of(model, data, f"{owner}_{part_name}_look_visual")
            points = transforms.apply(TWIN_FROM_TRUTH @ thing.pose.matrix, part.mesh.vertices.astype(np.float64))
            np.testing.assert_allclose(
                np.unique(found.round(4), axis=0).mean(axis=0),
                np.unique(points.round(4), axis=0).mean(axis=0),
                atol=2e-4,
            )
            np.testing.assert_allclose(found.min(axis=0), points.min(axis=0), atol=2e-5)
            np.testing.assert_allclose(found.max(axis=0), points.max(axis=0), atol=2e-5)


def test_masses_and_friction_are_the_declared_ones(world: World, true: TaskBundle) -> None:
    model, _ = opened(true)
    assert model.body("notebook").mass[0] == pytest.approx(1.2)
    assert model.body("notebook_lid").mass[0] == pytest.approx(0.4)
    assert model.body("cup").mass[0] == pytest.approx(0.31)
    assert model.body("red_box").mass[0] == pytest.approx(0.5)
    # A solid box of even density, turned as it stands: moments sorted as MuJoCo has them or not.
    x, y, z = 0.06, 0.16, 0.21
    expected = sorted(0.5 / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y]))
    np.testing.assert_allclose(sorted(model.body("red_box").inertia), expected, rtol=1e-4)
    for body, name in THINGS.items():
        matter = world.objects[name].matter
        assert matter is not None
        assert true.objects[body].friction == matter.friction
        assert true.objects[body].friction_sigma == 0.0
        assert true.objects[body].mass_scale == (1.0, 1.0)
        assert model.geom(f"{body}_collision_0").friction[0] == pytest.approx(matter.friction)


def test_the_lid_stands_truly_and_closes_at_zero(world: World, true: TaskBundle) -> None:
    model, data = opened(true)
    assert true.objects["notebook"].positions == pytest.approx((np.radians(108.0),))
    assert data.joint(LID).qpos[0] == pytest.approx(np.radians(108.0), abs=1e-5)
    np.testing.assert_allclose(model.joint(LID).range, [0.0, np.radians(135.0)], atol=1e-5)
    assert model.dof_frictionloss[model.joint(LID).dofadr[0]] == pytest.approx(0.8)
    data.joint(LID).qpos[0] = 0.0
    mujoco.mj_forward(model, data)
    lid = corners_of(model, data, "notebook_lid_lid_look_visual")
    # One millimetre of air above a base of 16 mm, then a lid of 7 mm.
    assert lid[:, 2].min() == pytest.approx(0.017, abs=1e-4)
    assert lid[:, 2].max() == pytest.approx(0.024, abs=1e-4)


@pytest.mark.medium
def test_a_twin_that_counts_the_other_way_round_keeps_its_sign(world: World, tmp_path: Path) -> None:
    placed = reference_tasks.assets(world)
    joint = placed["notebook"].body.joints[0]
    turned = joint.model_copy(update={"axis": (1.0, 0.0, 0.0), "lower": -2.3, "upper": 0.0, "position": -1.9})
    body = placed["notebook"].body.model_copy(update={"joints": (turned,)})
    other = placed["notebook"].model_copy(update={"body": body})
    made = build(tmp_path, reference_tasks.bundle({**placed, "notebook": other}), world)
    model, data = opened(made)
    assert data.joint(LID).qpos[0] == pytest.approx(-np.radians(108.0), abs=1e-5)
    np.testing.assert_allclose(model.joint(LID).range, [-np.radians(135.0), 0.0], atol=1e-5)


def test_it_stands_still(true: TaskBundle) -> None:
    run = settle.let_go(true.model, tuple(true.objects), 1.0)
    assert not run.diverged
    for motion in run.motions:
        assert motion.drift_m < 0.002, motion
        assert motion.tilt_rad < np.radians(1.0), motion
        assert motion.joints < np.radians(1.0), motion


def test_a_ball_that_is_dropped_into_the_mug_stays_inside(world: World, true: TaskBundle) -> None:
    middle = (TWIN_FROM_TRUTH @ world.objects["mug"].pose.matrix)[:3, 3]
    ball = reference_tasks.dropped_ball(true, middle + np.array([0.005, 0.0, 0.13]), radius=0.015)
    assert np.linalg.norm(ball[:2] - middle[:2]) < 0.037
    # It lies on the floor of the cavity, 4 mm above the table.
    assert ball[2] == pytest.approx(0.019, abs=0.002)


@pytest.mark.medium
def test_an_error_of_the_calibration_moves_everything_but_the_robot(world: World, tmp_path: Path) -> None:
    off = factories.pose(0.002, 0.0, 0.0, 0.003)
    twin = reference_tasks.bundle(reference_tasks.assets(world), off)
    model, data = opened(build(tmp_path, twin, world))
    np.testing.assert_allclose(pose_of(data, "robot/base"), twin.base_pose.matrix, atol=1e-5)
    table = corners_of(model, data, "static_table_look_visual")
    expected = transforms.apply(off @ TWIN_FROM_TRUTH, world.fixtures["table"].surface.vertices.astype(np.float64))
    np.testing.assert_allclose(table.min(axis=0), expected.min(axis=0), atol=1e-4)


def test_the_table_is_the_support_and_a_box(true: TaskBundle) -> None:
    model, data = opened(true)
    support = model.geom("static_support")
    assert support.type[0] == mujoco.mjtGeom.mjGEOM_BOX
    assert data.geom("static_support").xpos[2] + support.size[2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.medium
def test_the_robot_has_its_own_dynamics(twin: TaskBundle, true: TaskBundle, world: World, tmp_path: Path) -> None:
    (before, _), (after, data) = opened(twin), opened(true)
    ratio = after.actuator_gainprm[0, 0] / before.actuator_gainprm[0, 0]
    assert ratio != 1.0
    assert 0.92 <= ratio <= 1.08
    assert after.actuator_biasprm[0, 1] == pytest.approx(-after.actuator_gainprm[0, 0], rel=1e-5)
    assert after.dof_frictionloss[after.joint("robot/turn").dofadr[0]] == pytest.approx(0.2)
    assert after.opt.timestep == pytest.approx(0.001)
    assert true.latency_s == pytest.approx(0.01)
    assert data.joint("robot/turn").qpos[0] == pytest.approx(0.3)
    assert data.ctrl[0] == pytest.approx(0.3)
    other, _ = opened(build(tmp_path, twin, world, seed=1))
    assert other.actuator_gainprm[0, 0] != after.actuator_gainprm[0, 0]


@pytest.mark.medium
def test_the_same_inputs_give_the_same_bytes(twin: TaskBundle, true: TaskBundle, world: World, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    assert runner.encode(build(tmp_path, twin, world)) == runner.encode(true)


def test_nothing_of_the_twins_surfaces_is_left(true: TaskBundle) -> None:
    text = true.model.files["scene.xml"].decode()
    assert "background" not in text
    assert not [name for name in true.model.files if "background" in name]
    assert all(name.removeprefix("assets/") in text for name in true.model.files if name != "scene.xml")


@pytest.mark.medium
def test_what_the_twin_does_not_know_is_there_too(world: World, tmp_path: Path) -> None:
    placed = reference_tasks.assets(world)
    del placed["cup"]
    twin = reference_tasks.bundle(placed)
    made = build(tmp_path, twin, world)
    (before, _), (after, data) = opened(twin), opened(made)
    assert set(made.objects) == {"red_box", "notebook"}
    assert after.nq == before.nq + 7
    assert after.joint(after.njnt - 1).name == "mug"
    np.testing.assert_allclose(pose_of(data, "mug"), TWIN_FROM_TRUTH @ world.objects["mug"].pose.matrix, atol=1e-5)


def test_the_stub_has_the_same_form(twin: TaskBundle, true: TaskBundle, world: World, tmp_path: Path) -> None:
    stub = build(tmp_path, twin, world, backend="stub")
    assert stub.kind == "reference"
    assert list(stub.objects) == list(true.objects)
    assert stub.latency_s == true.latency_s
    assert all(thing.mass_scale == (1.0, 1.0) and not thing.friction_sigma for thing in stub.objects.values())


def elsewhere(asset: Asset) -> Asset:
    return asset.model_copy(update={"pose": factories.placed(factories.pose(-0.3, -0.3))})


def test_an_asset_without_a_thing_is_named(world: World, tmp_path: Path) -> None:
    twin = reference_tasks.bundle(reference_tasks.assets(world, ghost=elsewhere(factories.box_asset())))
    with pytest.raises(RuleError, match="nothing in the reference world is `ghost`") as error:
        build(tmp_path, twin, world)
    assert "cm away" in str(error.value.facts["nearest thing"])
    assert "carton" in str(error.value.facts["things"])
    assert error.value.hint


def test_two_assets_of_one_thing_are_one_too_many(world: World, tmp_path: Path) -> None:
    placed = reference_tasks.assets(world)
    twin = reference_tasks.bundle({**placed, "red_box_2": placed["red_box"]})
    with pytest.raises(RuleError, match="nothing in the reference world is `red_box"):
        build(tmp_path, twin, world)


@pytest.mark.medium
def test_impossible_pairs_are_refused(twin: TaskBundle, world: World, tmp_path: Path) -> None:
    laptop = world.objects["laptop"]
    stiff = world.model_copy(update={"objects": {**world.objects, "laptop": laptop.model_copy(update={"hinge": None})}})
    with pytest.raises(RuleError, match="the joints of `notebook` in the twin are not those of its thing") as error:
        build(tmp_path, twin, stiff)
    assert error.value.facts["thing"] == "no hinge"
    massless = world.model_copy(
        update={"objects": {**world.objects, "laptop": laptop.model_copy(update={"matter": None})}}
    )
    with pytest.raises(RuleError, match="`notebook` is a thing without mass"):
        build(tmp_path, twin, massless)
    with pytest.raises(RuleError, match="the reference world has no robot") as error:
        build(tmp_path, twin, world.model_copy(update={"stand": None}))
    assert error.value.hint


def test_only_a_twins_task_for_this_robot_has_a_reference(
    true: TaskBundle, twin: TaskBundle, world: World, tmp_path: Path
) -> None:
    with pytest.raises(RuleError, match="this one is `reference`"):
        build(tmp_path, true, world)
    other = reference_tasks.robot().model_copy(update={"source": "another"})
    with pytest.raises(RuleError, match="not the robot of the reference world"):
        RuleRunner(tmp_path).run("reference.task", bundle=twin, world=world, robot=other)
