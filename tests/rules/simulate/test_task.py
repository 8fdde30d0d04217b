"""simulate.task: what becomes of a scene, a robot and an objective."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import episodes, factories

CLOSE = {"name": "Close", "primitive": "articulate", "object": "laptop", "joints_deg": {"hinge": 0.0}}
LIFT = {"name": "Lift", "primitive": "lift", "object": "blue_box", "height_m": 0.08}


@pytest.fixture
def make(tmp_path):
    runner = RuleRunner(tmp_path)
    assets = Collection[Asset](
        items={
            "Blue Box": factories.box_asset(place=factories.pose(0.3, 0.0), mass=0.4),
            "laptop": factories.laptop_asset(place=factories.pose(-0.3, 0.2)),
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
    assert set(bundle.objects) == {"blue_box", "laptop"}
    (joint,) = bundle.objects["laptop"].joints
    assert bundle.task.joints == {joint: 0.0}
    assert bundle.task.tolerance == pytest.approx(np.radians(4.0))
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
        ({**LIFT, "object": "green_mug"}, "the scene has no object `green_mug`"),
        ({**CLOSE, "joints_deg": {}}, "`Close` names no joint to move"),
        ({**CLOSE, "joints_deg": {"lid": 0.0}}, "`laptop` has no joint `lid`"),
        ({**CLOSE, "joints_deg": {"hinge": 200.0}}, "joint `hinge` cannot reach 200.0°"),
    ],
)
def test_what_cannot_be_done_is_refused(make, options, message):
    with pytest.raises(RuleError, match=message):
        make(options)


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
    assert {"scene.xml", "robot.xml"} <= set(bundle.model.files)
