"""simulate.task: what becomes of a scene, a robot and an objective."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.sim.primitives import catalogue, folders
from dextera_build.sim.runtime import variations
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import episodes, factories

BARE = {"name": "Task", "object": "blue_box"}
CLOSE = {"name": "Close", "primitive": "articulate", "object": "laptop", "articulate": {"joints_deg": {"hinge": 0.0}}}
LIFT = {**BARE, "name": "Lift", "primitive": "lift", "lift": {"height_m": 0.08}}
PUSH = {**BARE, "name": "Push", "primitive": "push", "push": {"by_m": (0.1, 0.05)}}
PLACE = {**BARE, "name": "Place", "primitive": "pick_and_place", "pick_and_place": {"into": "bowl"}}


def put(**own):
    return {**PLACE, "pick_and_place": own}


def joints(**commands):
    return {**CLOSE, "articulate": {"joints_deg": commands}}


@pytest.fixture(scope="module")
def assets():
    return Collection[Asset](
        items={
            "Blue Box": factories.box_asset(place=factories.pose(0.3, 0.0), mass=0.4),
            "laptop": factories.laptop_asset(place=factories.pose(-0.3, 0.2)),
            "bowl": factories.bowl_asset(factories.pose(0.0, 0.35), radius=0.09, height=0.07),
        }
    )


@pytest.fixture(scope="module")
def scene(assets, tmp_path_factory):
    return RuleRunner(tmp_path_factory.mktemp("scene")).run(
        "simulate.scene",
        assets=assets,
        background=factories.background(0.8),
        support=factories.support(0.8),
        camera=factories.camera(),
    )


@pytest.fixture
def make(tmp_path, assets, scene):
    runner = RuleRunner(tmp_path)
    base = Pose(parent="world", child="base", matrix=factories.pose(0.0, -0.5, 0.0, yaw=1.5))

    def run(options, profile="cpu", **changed):
        inputs = {"scene": scene, "assets": assets, "robot": episodes.robot(), "base": base, **changed}
        return runner.run("simulate.task", profile=profile, options=options, **inputs)

    run.runner, run.scene, run.assets = runner, scene, assets
    return run


@pytest.mark.medium
def test_names_goals_and_uncertainty_are_those_of_the_assets(make):
    bundle = make({**CLOSE, "articulate": {"joints_deg": {"hinge": 0.0}, "tolerance_deg": 4.0}})
    assert set(bundle.objects) == {"blue_box", "bowl", "laptop"}
    (joint,) = bundle.objects["laptop"].joints
    assert bundle.task.primitive == "articulate"
    goal = catalogue.of(bundle.task).goal
    assert goal.joints == {joint: 0.0}
    assert goal.tolerance == pytest.approx(np.radians(4.0))
    low, high = bundle.objects["blue_box"].mass_scale
    assert low < 1.0 < high
    environment = Environment(bundle)
    assert environment.model.body_mass[environment.model.body("blue_box").id] == pytest.approx(0.4)
    assert environment.model.ncam == 0


@pytest.mark.medium
def test_the_robot_stands_where_its_base_is(make):
    bundle = make(LIFT)
    environment = Environment(bundle)
    assert np.allclose(environment.data.body("robot/base").xpos, [0.0, -0.5, 0.0])
    poses = dict(zip(bundle.objects, environment.object_poses(), strict=True))
    # The base looks along its x axis, turned by 1.5 rad: the box stands 0.3 m to the right of where it looks.
    seen = np.linalg.inv(bundle.base_pose.matrix) @ [0.3, 0.0, 0.0, 1.0]
    assert np.allclose(poses["blue_box"][:3], seen[:3], atol=1e-6)


@pytest.mark.medium
def test_episodes_begin_with_the_base_off_as_far_as_its_calibration_may_be(make):
    support, covariance = factories.support(0.8), np.diag([1e-6, 4e-6, 9e-6, 1e-5, 2e-5, 3e-5])
    mount = transforms.invert(support.camera_pose.matrix) @ factories.pose(0.0, -0.5, 0.0, yaw=1.5)
    measured = Pose(parent="camera", child="base", matrix=mount, covariance=covariance)
    base = make.runner.run("align.base", support=support, measured=measured)
    environment = Environment(make({**LIFT, "reset": {"visual": 1.0}}, base=base))
    errors = np.array([environment.draw(seed).base_error for seed in range(200)])
    assert np.sqrt(np.mean(errors**2, axis=0)) == pytest.approx(np.sqrt(np.diag(base.covariance)), rel=0.2)
    # The camera has the same calibration, so it is off from the robot by that alone, and not from the objects.
    view = make.runner.run("simulate.view", scene=make.scene, measured=measured)
    assert view.camera_pose.covariance is not None
    environment.reset(3)
    assert variations.seen(environment.bundle, environment.start, {"front": view}).cameras == {}


@pytest.mark.medium
def test_the_home_keyframe_holds_the_photograph_and_the_robot(make):
    environment = Environment(make(CLOSE))
    (hinge,) = environment.bundle.objects["laptop"].joints
    assert environment.data.joint(hinge).qpos[0] == pytest.approx(1.9)
    assert np.allclose(environment.measure().joints, episodes.HOME)


def test_a_twin_of_unknown_scale_is_refused(make):
    with pytest.raises(RuleError) as caught:
        make(LIFT, scene=make.scene.model_copy(update={"scale": "unknown"}))
    assert caught.value.message == "the scale of this twin is unknown, so no task can be built on it"
    assert caught.value.hint == (
        "state one size (`object` and `size_m` of `align.scale`), lay a marker on the support (`marker` of "
        "`align.support`), or measure depth"
    )


def test_an_object_that_is_held_is_refused_with_the_reason(make):
    twin = make.scene.model_copy(
        update={
            "bodies": tuple(name for name in make.scene.bodies if name != "blue_box"),
            "held": {"blue_box": "nothing carries it: it would fall by 47 mm"},
        }
    )
    with pytest.raises(RuleError) as caught:
        make(LIFT, scene=twin)
    assert caught.value.message == "`blue_box` cannot be moved: it is held as a part of the static scene"
    assert caught.value.facts == {"why": "nothing carries it: it would fall by 47 mm", "free": "bowl, laptop"}
    assert caught.value.hint == "see the warnings of `simulate.steady`, and correct its mask or shape"


@pytest.mark.parametrize(
    ("options", "message", "facts", "hint"),
    [
        (
            {**LIFT, "limbs": ("left", "right")},
            "the robot has no limb `left`",
            {"limbs": "arm"},
            "name `arm`, or choose a robot with more limbs, such as robot/openarm_revo1",
        ),
        (
            {**BARE, "primitive": "handover"},
            "`handover` takes 2 hands, but the robot has 1",
            {"limbs": "arm"},
            "choose a robot with more limbs, such as robot/openarm_revo1",
        ),
        (
            put(into="bowls"),
            "the scene has no container `bowls`",
            {"objects": "bowl, laptop"},
            "did you mean `bowl`?",
        ),
        (
            put(into="blue_box"),
            "the scene has no container `blue_box`",
            {"objects": "bowl, laptop"},
            "set `into` to one of the other objects",
        ),
        (
            put(into="laptop"),
            "`laptop` is no container: nothing stays in it",
            {"objects": "bowl, laptop"},
            "set `by_m` or `to_m` for a place on it, or `into` to another object",
        ),
        (
            {**LIFT, "object": "green_mug"},
            "the scene has no object `green_mug`",
            {"objects": "blue_box, bowl, laptop"},
            "set `object: blue_box`",
        ),
        (
            joints(lid=0.0),
            "`laptop` has no joint `lid`",
            {"joints": "hinge"},
            "set `joints_deg: {hinge: 0}`",
        ),
        (
            joints(hing=0.0),
            "`laptop` has no joint `hing`",
            {"joints": "hinge"},
            "did you mean `hinge`?",
        ),
        (
            {**CLOSE, "object": "bowl"},
            "`bowl` has no joint `hinge`",
            {"joints": "none"},
            "choose an object with a joint",
        ),
        (
            joints(hinge=200.0),
            "joint `hinge` cannot reach 200.0°",
            {"limits": "0.0° to 131.8°"},
            "set `joints_deg` inside the limits",
        ),
    ],
)
def test_what_cannot_be_done_is_refused(make, options, message, facts, hint):
    with pytest.raises(RuleError) as caught:
        make(options)
    assert (caught.value.message, caught.value.facts, caught.value.hint) == (message, facts, hint)


@pytest.mark.parametrize(
    ("options", "what", "place"),
    [
        ({**PUSH, "push": {"by_m": (3.0, 0.0)}}, "the target of `Push`", "x 3.30, y 0.00, z 0.00 m in the world"),
        (
            {**BARE, "primitive": "pick_and_reorient", "pick_and_reorient": {"by_m": (0.0, 0.0, 2.0)}},
            "the target of `Task`",
            "x 0.30, y 0.00, z 2.00 m in the world",
        ),
        (
            put(to_m=(0.0, 3.0, 0.0)),
            "the target of `Place`",
            "x 0.00, y 3.00, z 0.00 m in the world",
        ),
        ({**LIFT, "lift": {"height_m": 2.0}}, "the target of `Lift`", "z 2.00 m in the world"),
    ],
)
def test_a_target_beyond_the_arm_is_refused(make, options, what, place):
    with pytest.raises(RuleError) as caught:
        make(options)
    assert caught.value.message == f"{what} is out of reach of limb `arm`"
    assert caught.value.facts["place"] == place
    assert caught.value.facts["distance"].endswith(" m from `joint_1`")
    assert caught.value.facts["reach"].startswith("at most 0.60 m of links and hand, and 0.")
    assert caught.value.hint == "move the robot with `position_m` of `align.base`, or change the goal"


def test_an_object_beyond_the_arm_is_refused(make):
    far = Pose(parent="world", child="base", matrix=factories.pose(0.0, -3.0, 0.0, yaw=1.5))
    with pytest.raises(RuleError, match="`blue_box` is out of reach of limb `arm`") as caught:
        make(LIFT, base=far)
    assert caught.value.facts["distance"] == "3.02 m from `joint_1`"


@pytest.mark.parametrize("pieces", [None, ()])
def test_an_asset_without_collision_geometry_is_refused(make, pieces):
    bare = make.assets.items["Blue Box"]
    links = {} if pieces is None else {k: v.model_copy(update={"hulls": ()}) for k, v in bare.collision.links.items()}
    bare = bare.model_copy(update={"collision": bare.collision.model_copy(update={"links": links})})
    with pytest.raises(RuleError, match="link `base` of `Blue Box` has no collision geometry") as caught:
        make(CLOSE, assets=Collection[Asset](items={**make.assets.items, "Blue Box": bare}))
    assert caught.value.code == "DXB-B219"
    assert caught.value.facts == {"links": "base", "collision geometry": "of no link"}
    assert caught.value.hint == "`factorize.collision` and `factorize.physics` of the same body give both"


def test_an_asset_that_the_scene_was_not_made_of_is_refused(make):
    spoon = factories.box_asset(place=factories.pose(0.2, 0.2), mass=0.1)
    with pytest.raises(RuleError, match="the scene has no body of asset `spoon`") as caught:
        make(LIFT, assets=Collection[Asset](items={**make.assets.items, "spoon": spoon}))
    assert caught.value.facts == {"assets": "Blue Box, bowl, laptop, spoon", "scene": "blue_box, bowl, laptop"}
    assert caught.value.hint == "give the assets that `simulate.scene` was given"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({**LIFT, "limbs": ("arm", "arm")}, "`limbs` names one limb twice"),
        ({**LIFT, "hold_s": 8.0}, "`hold_s` leaves no time before `timeout_s`"),
    ],
)
def test_options_that_make_no_task_are_refused_before_anything_is_built(make, options, message):
    own = {name: value for name, value in options.items() if name != options["primitive"]}
    with pytest.raises(ValidationError, match=message):
        make.runner.find("simulate.task").rule.options.model_validate(own)


@pytest.mark.parametrize(
    ("primitive", "own", "message"),
    [
        ("push", {"by_m": (0.1, 0.0, 0.2)}, "by_m"),
        ("push", {}, "it needs one target"),
        ("push", {"by_m": (0.1, 0.0), "to_m": (0.3, 0.1)}, "it needs one target"),
        ("push", {"height_m": 0.1}, "height_m"),
        ("pick_and_place", {}, "there is no target; set `into`, `by_m` or `to_m`"),
        ("pick_and_place", {"into": "bowl", "by_m": (0.1, 0.0, 0.0)}, "`into` and a pose both give a target"),
        ("pick_and_place", {"by_m": (0.1, 0.0, 0.0), "to_m": (0.1, 0.0, 0.0)}, "`by_m` and `to_m` both give a target"),
        ("pick_and_reorient", {}, "there is no target"),
        ("articulate", {}, "`joints_deg` names no joint to move"),
        ("handover", {"giver": "left", "receiver": "left"}, "`giver` and `receiver` are both `left`"),
    ],
)
def test_options_that_make_no_goal_are_refused(primitive, own, message):
    with pytest.raises(ValidationError, match=message):
        folders.module(primitive, "primitive").Options.model_validate(own)


def test_limbs_of_a_goal_that_names_its_hands_are_refused(make):
    robot = episodes.robot()
    robot = robot.model_copy(update={"limbs": dict.fromkeys(("left", "right"), robot.limbs["arm"])})
    with pytest.raises(RuleError, match="`limbs` gives the hands of `handover` no roles"):
        make({**BARE, "primitive": "handover", "handover": {"giver": "left"}, "limbs": ("left", "right")}, robot=robot)


@pytest.mark.medium
def test_a_kind_of_action_that_the_robot_lacks_is_refused(make):
    assert make({**LIFT, "action": "end_effector"}).task.action == "end_effector"
    robot = episodes.robot()
    limbs = {name: limb.model_copy(update={"palm": ""}) for name, limb in robot.limbs.items()}
    with pytest.raises(RuleError, match="move palms, but no limb of the robot has one"):
        make({**LIFT, "action": "end_effector"}, robot=robot.model_copy(update={"limbs": limbs}))


@pytest.mark.parametrize(
    ("asked", "steps", "hint"),
    [
        (5000.0, "2 ms each, 1 of them are 500 Hz", "set `control_hz: 500`"),
        (200.0, "2 ms each, 2 of them are 250 Hz", "set `control_hz: 166.7`"),
    ],
)
def test_a_rate_that_the_simulation_cannot_keep_is_refused(make, asked, steps, hint):
    with pytest.raises(RuleError, match=f"the simulation cannot keep `control_hz: {asked:g}`") as caught:
        make({**LIFT, "control_hz": asked})
    assert caught.value.facts == {"steps": steps}
    assert caught.value.hint == hint


@pytest.mark.medium
def test_a_push_has_its_target_in_the_world_and_policies_see_it_in_the_base(make):
    bundle = make({**PUSH, "push": {**PUSH["push"], "yaw_deg": 90.0}})
    environment = Environment(bundle)
    goal = environment.primitive.goal
    assert goal.place_m == pytest.approx((0.4, 0.05))
    names = dict(zip(goal.names, environment.goal, strict=True))
    seen = np.linalg.inv(bundle.base_pose.matrix) @ [0.4, 0.05, 0.0, 1.0]
    assert (names["x"], names["y"]) == pytest.approx(seen[:2])
    ahead = bundle.base_pose.matrix[:3, :3] @ [names["heading_x"], names["heading_y"], 0.0]
    assert ahead == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    assert np.array_equal(environment.reset(0)["goal"], environment.goal)
    assert not environment.judge.held_at_reset


@pytest.mark.medium
def test_a_container_is_measured_for_those_that_are_put_into_it(make):
    bundle = make(PLACE)
    cavity = bundle.objects["bowl"].cavity
    assert bundle.objects["laptop"].cavity is bundle.objects["blue_box"].cavity is None
    deep = float((cavity.rim_m - cavity.floor_m).max())
    assert 0.05 < deep < 0.07
    room = float((cavity.rim_m - cavity.floor_m).sum()) * cavity.cell_m**2
    assert room < np.pi * 0.09**2 * 0.07
    assert catalogue.of(bundle.task).goal.into == "bowl"


def test_a_base_in_another_frame_is_refused(make):
    base = Pose(parent="camera", child="base", matrix=np.eye(4))
    with pytest.raises(RuleError, match="given in `camera`, not in the world"):
        make(LIFT, base=base)


def test_a_task_without_room_says_what_collides(make):
    with pytest.raises(RuleError, match="no start of `Lift` without collisions was found") as caught:
        make(LIFT, base=Pose(parent="world", child="base", matrix=factories.pose(0.3, 0.0, 0.0)))
    assert caught.value.facts["draws"] == "200, none accepted"
    assert "blue_box and robot/base (200x)" in caught.value.facts["collisions"]
    assert caught.value.facts["ranges"] == "position_m 0.05, clutter_m 0.01, yaw_deg 20, robot_deg 2"
    assert caught.value.hint == (
        "move the robot with `position_m` of `align.base`, or make the ranges of `reset` smaller"
    )


def test_the_stub_takes_what_is_there(make):
    bundle = make({**CLOSE, "object": "black_laptop"}, profile="stub")
    assert bundle.task.object in bundle.objects
    bundle = make({**put(into="basket"), "object": "red_box"}, profile="stub")
    assert bundle.task.object in bundle.objects
    assert {"scene.xml", "robot.xml"} <= set(bundle.model.files)
