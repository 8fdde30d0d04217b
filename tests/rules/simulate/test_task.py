"""simulate.task: what becomes of a scene, a robot and an objective."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import episodes, factories

CLOSE = {"name": "Close", "primitive": "articulate", "object": "laptop", "joints_deg": {"hinge": 0.0}}
LIFT = {"name": "Lift", "primitive": "lift", "object": "blue_box", "height_m": 0.08}
BARE = {"name": "Task", "object": "blue_box"}
PUSH = {"name": "Push", "primitive": "push", "object": "blue_box", "by_m": (0.1, 0.05)}
PLACE = {"name": "Place", "primitive": "pick_and_place", "object": "blue_box", "into": "bowl"}


@pytest.fixture
def make(tmp_path):
    runner = RuleRunner(tmp_path)
    assets = Collection[Asset](
        items={
            "Blue Box": factories.box_asset(place=factories.pose(0.3, 0.0), mass=0.4),
            "laptop": factories.laptop_asset(place=factories.pose(-0.3, 0.2)),
            "bowl": factories.bowl_asset(factories.pose(0.0, 0.35), radius=0.09, height=0.07),
        }
    )
    scene = runner.run(
        "simulate.scene",
        assets=assets,
        background=factories.background(0.8),
        support=factories.support(0.8),
        camera=factories.camera(),
    )
    base = Pose(parent="world", child="base", matrix=factories.pose(0.0, -0.5, 0.0, yaw=1.5))

    def run(options, profile="cpu", **changed):
        inputs = {"scene": scene, "assets": assets, "robot": episodes.robot(), "base": base, **changed}
        return runner.run("simulate.task", profile=profile, options=options, **inputs)

    run.runner, run.scene = runner, scene
    return run


def test_names_goals_and_uncertainty_are_those_of_the_assets(make):
    bundle = make({**CLOSE, "tolerance_deg": 4.0})
    assert set(bundle.objects) == {"blue_box", "bowl", "laptop"}
    (joint,) = bundle.objects["laptop"].joints
    assert bundle.task.primitive == "articulate"
    assert bundle.task.goal.joints == {joint: 0.0}
    assert bundle.task.goal.tolerance == pytest.approx(np.radians(4.0))
    low, high = bundle.objects["blue_box"].mass_scale
    assert low < 1.0 < high
    environment = Environment(bundle)
    assert environment.model.body_mass[environment.model.body("blue_box").id] == pytest.approx(0.4)
    assert environment.model.ncam == 0


def test_the_robot_stands_where_its_base_is(make):
    bundle = make(LIFT)
    environment = Environment(bundle)
    assert np.allclose(environment.data.body("robot/base").xpos, [0.0, -0.5, 0.0])
    poses = dict(zip(bundle.objects, environment.object_poses(), strict=True))
    # The base looks along its x axis, turned by 1.5 rad: the box stands 0.3 m to the right of where it looks.
    seen = np.linalg.inv(bundle.base_pose.matrix) @ [0.3, 0.0, 0.0, 1.0]
    assert np.allclose(poses["blue_box"][:3], seen[:3], atol=1e-6)


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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({**LIFT, "limbs": ("left",)}, "the robot has no limb `left`"),
        ({**PUSH, "by_m": None}, "`Push` needs one target"),
        ({**PUSH, "to_m": (0.3, 0.1)}, "`Push` needs one target"),
        ({**PLACE, "into": None}, "`Place` has no target"),
        ({**PLACE, "into": "basket"}, "the scene has no container `basket`"),
        ({**PLACE, "into": "blue_box"}, "the scene has no container `blue_box`"),
        ({**PLACE, "into": "laptop"}, "`laptop` is no container"),
        ({**PLACE, "into": "bowl", "by_m": (0.1, 0.0, 0.0)}, "a target is given by `into` and by a pose"),
        ({**BARE, "primitive": "pick_and_reorient"}, "`Task` has no target"),
        ({**BARE, "primitive": "handover"}, "`handover` takes 2 hands, but the robot has 1"),
        ({**LIFT, "object": "green_mug"}, "the scene has no object `green_mug`"),
        ({**CLOSE, "joints_deg": {}}, "`Close` names no joint to move"),
        ({**CLOSE, "joints_deg": {"lid": 0.0}}, "`laptop` has no joint `lid`"),
        ({**CLOSE, "joints_deg": {"hinge": 200.0}}, "joint `hinge` cannot reach 200.0°"),
    ],
)
def test_what_cannot_be_done_is_refused(make, options, message):
    with pytest.raises(RuleError, match=message):
        make(options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({**PUSH, "height_m": 0.1}, "`height_m` is no option of primitive `push`, which has"),
        ({**LIFT, "giver": "left"}, "`giver` is no option of primitive `lift`"),
        ({**PUSH, "by_m": (0.1, 0.0, 0.2)}, "`by_m` of primitive `push`"),
        ({**LIFT, "primitive": "throw"}, "primitive"),
    ],
)
def test_options_of_another_primitive_are_refused_before_anything_is_built(make, options, message):
    with pytest.raises(ValidationError, match=message):
        make.runner.find("simulate.task").rule.options.model_validate(options)


def test_a_push_has_its_target_in_the_world_and_policies_see_it_in_the_base(make):
    bundle = make({**PUSH, "yaw_deg": 90.0})
    goal = bundle.task.goal
    assert goal.place_m == pytest.approx((0.4, 0.05))
    names = dict(zip(goal.names, bundle.goal_numbers, strict=True))
    seen = np.linalg.inv(bundle.base_pose.matrix) @ [0.4, 0.05, 0.0, 1.0]
    assert (names["x"], names["y"]) == pytest.approx(seen[:2])
    ahead = bundle.base_pose.matrix[:3, :3] @ [names["heading_x"], names["heading_y"], 0.0]
    assert ahead == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    environment = Environment(bundle)
    assert environment.reset(0).goal == pytest.approx(bundle.goal_numbers)
    assert not environment.judge.held_at_reset


def test_a_container_is_measured_for_those_that_are_put_into_it(make):
    bundle = make(PLACE)
    cavity = bundle.objects["bowl"].cavity
    assert bundle.objects["laptop"].cavity is bundle.objects["blue_box"].cavity is None
    deep = float((cavity.rim_m - cavity.floor_m).max())
    assert 0.05 < deep < 0.07
    room = float((cavity.rim_m - cavity.floor_m).sum()) * cavity.cell_m**2
    assert room < np.pi * 0.09**2 * 0.07
    assert bundle.task.goal.into == "bowl"


def test_a_base_in_another_frame_is_refused(make):
    base = Pose(parent="camera", child="base", matrix=np.eye(4))
    with pytest.raises(RuleError, match="given in `camera`, not in the world"):
        make(LIFT, base=base)


def test_a_task_without_room_says_so(make):
    with pytest.raises(RuleError, match="no start of `Lift` without collisions"):
        make(LIFT, base=Pose(parent="world", child="base", matrix=factories.pose(0.3, 0.0, 0.0)))


def test_the_stub_takes_what_is_there(make):
    bundle = make({**CLOSE, "object": "black_laptop"}, profile="stub")
    assert bundle.task.object in bundle.objects
    bundle = make({**PLACE, "object": "red_box", "into": "basket"}, profile="stub")
    assert bundle.task.object in bundle.objects
    assert {"scene.xml", "robot.xml"} <= set(bundle.model.files)
