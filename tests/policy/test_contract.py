"""What a policy may be run on, and how it refuses the rest."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import Reset, TaskBundle, View
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, transforms
from dextera_build.policy import contract as contracts
from dextera_build.policy import layout
from dextera_build.policy.cameras import given
from tests import episodes
from tests.policy import policies

BUNDLE = episodes.bundle()


def refused(contract: PolicyContract, bundle: TaskBundle = BUNDLE, **more: object) -> RuleError:
    with pytest.raises(RuleError) as caught:
        contracts.check(contract, bundle, **more)
    assert caught.value.code == "DXB-B502"
    return caught.value


def with_joints(bundle: TaskBundle, **changes: object) -> TaskBundle:
    """The bundle with other joints of its robot; `order` permutes them, `upper` and `names` replace."""
    joints = list(bundle.robot.joints)
    if "upper" in changes:
        joints[0] = joints[0].model_copy(update={"upper": changes["upper"]})
    if "name" in changes:
        joints[0] = joints[0].model_copy(update={"name": changes["name"]})
    order = changes.get("order", range(len(joints)))
    robot = bundle.robot.model_copy(update={"joints": tuple(joints[number] for number in order)})
    return bundle.model_copy(update={"robot": robot})


def with_task(bundle: TaskBundle, **changes: object) -> TaskBundle:
    return bundle.model_copy(update={"task": bundle.task.model_copy(update=changes)})


def test_a_policy_fits_the_bundle_it_was_made_for():
    contracts.check(policies.contract(BUNDLE), BUNDLE)


def test_a_policy_fits_every_world_of_its_task():
    contracts.check(policies.contract(BUNDLE), BUNDLE.model_copy(update={"kind": "reference"}))


def test_it_fits_where_there_are_more_objects_than_it_knows():
    only = policies.contract(BUNDLE)
    fewer = contracts.channel(layout.of_bundle(BUNDLE), "objects", only=("case",))
    assert fewer.names == ("case",)
    contracts.check(only.model_copy(update={"inputs": (fewer,)}), BUNDLE)


def test_another_embodiment_is_refused():
    other = with_joints(BUNDLE, name="elbow")
    error = refused(policies.contract(BUNDLE), other)
    assert "other actions" in error.message
    assert "another embodiment" in error.message
    assert "3 (elbow, joint_2, joint_3)" in error.facts["other actions"]


def test_other_limits_are_another_embodiment():
    error = refused(policies.contract(BUNDLE), with_joints(BUNDLE, upper=1.0))
    assert error.message == "the policy does not fit the task bundle: another embodiment"
    assert error.facts["another embodiment"].endswith("the names agree, the limits do not")


def test_another_order_of_actions_is_refused_and_the_first_place_is_named():
    error = refused(policies.contract(BUNDLE, inputs=("goal",)), with_joints(BUNDLE, order=(0, 2, 1)))
    assert "actions in another order" in error.message
    assert error.facts["actions in another order"] == (
        "component 1 is `joint_2` for the policy, `joint_3` in the bundle"
    )


def test_another_task_is_refused():
    error = refused(policies.contract(BUNDLE), with_task(BUNDLE, name="LiftCup"))
    assert error.facts == {"another task": "the policy has LiftBox, the bundle has LiftCup"}


def test_another_rate_is_refused():
    error = refused(policies.contract(BUNDLE), rate_hz=50.0)
    assert error.facts == {"another rate": "the policy has 20 Hz, the bundle has 50 Hz"}


def test_a_missing_camera_is_refused():
    error = refused(policies.contract(BUNDLE, inputs=("joints", "rgb"), view=episodes.view()))
    assert error.facts == {"no view": "the policy looks at 64 x 48 px"}


def test_a_view_of_another_size_is_refused():
    seeing = policies.contract(BUNDLE, inputs=("joints", "rgb"), view=episodes.view())
    contracts.check(seeing, BUNDLE, views=given(episodes.view()))
    error = refused(seeing, views=given(episodes.view(128, 96)))
    assert error.facts == {"a view of another size": "the policy has 64 x 48 px, the bundle has 128 x 96 px"}


def moved(view: View, x_m: float = 0.0, turn_rad: float = 0.0, zoom: float = 1.0, sigma_m: float = 0.0) -> View:
    """The view from elsewhere, `x_m` away and turned about its axis, with another focal length."""
    pose = view.camera_pose
    matrix = pose.matrix @ transforms.rigid(lie.about_z(turn_rad)[:3, :3], np.array([x_m, 0.0, 0.0]))
    covariance = np.diag([sigma_m**2 / 3] * 3 + [0.0] * 3) if sigma_m else None
    camera = view.camera.model_copy(update={"fx": zoom * view.camera.fx, "fy": zoom * view.camera.fy})
    return view.model_copy(
        update={
            "camera": camera,
            "camera_pose": pose.model_copy(update={"matrix": matrix, "covariance": covariance}),
        }
    )


@pytest.mark.parametrize(
    ("changed", "difference"),
    [
        ({"x_m": 0.5}, "the camera at another place"),
        ({"turn_rad": np.pi}, "the camera at another place"),
        ({"zoom": 2.0}, "the camera with another field of view"),
        ({"x_m": 0.05, "sigma_m": 0.005}, "the camera at another place"),
    ],
)
def test_a_camera_at_another_place_or_with_another_lens_is_refused(changed, difference):
    seeing = policies.contract(BUNDLE, inputs=("joints", "rgb"), view=episodes.view())
    error = refused(seeing, views=given(moved(episodes.view(), **changed)))
    assert list(error.facts) == [difference]


def test_a_camera_of_several_at_another_place_is_named():
    views = {"front": episodes.view(), "side": moved(episodes.view(), x_m=0.3)}
    seeing = policies.contract(BUNDLE, inputs=("joints", "rgb/front", "rgb/side"), views=views)
    contracts.check(seeing, BUNDLE, views=views)
    error = refused(seeing, views=views | {"side": episodes.view()})
    assert error.facts == {
        "camera `side` at another place": (
            "0.300 m and 0.0 deg from the camera of the policy's data; "
            "0.010 m and 1.0 deg are accepted for its calibration"
        )
    }


def test_what_a_calibration_explains_is_accepted():
    seeing = policies.contract(BUNDLE, inputs=("joints", "rgb"), view=moved(episodes.view(), sigma_m=0.01))
    contracts.check(seeing, BUNDLE, views=given(moved(episodes.view(), x_m=0.008, turn_rad=0.01, zoom=1.01)))
    contracts.check(seeing, BUNDLE, views=given(moved(episodes.view(), x_m=0.035)))
    refused(seeing, views=given(moved(episodes.view(), x_m=0.05)))
    spread = with_task(BUNDLE, reset=Reset(visual=1.0))
    contracts.check(seeing, spread, views=given(moved(episodes.view(), x_m=0.05)))


def test_a_contract_that_states_no_camera_takes_any():
    """As those of policies that were trained before contracts stated their cameras."""
    seeing = policies.contract(BUNDLE, inputs=("joints", "rgb"), view=episodes.view())
    older = {name: value for name, value in seeing.model_dump().items() if name != "views"}
    contracts.check(PolicyContract.model_validate(older), BUNDLE, views=given(moved(episodes.view(), x_m=0.5)))


def test_another_size_of_a_channel_is_refused():
    case = {"case": BUNDLE.objects["case"]}
    error = refused(policies.contract(BUNDLE, inputs=("objects",)), BUNDLE.model_copy(update={"objects": case}))
    assert error.facts == {"another size of `objects`": "the policy has 2 (box, case), the bundle has 1 (case)"}


def test_an_object_of_another_name_is_refused():
    objects = {"box": BUNDLE.objects["box"], "tin": BUNDLE.objects["case"]}
    error = refused(policies.contract(BUNDLE, inputs=("objects",)), BUNDLE.model_copy(update={"objects": objects}))
    assert error.facts == {"other `objects`": "the bundle has no case, but box, tin"}


def test_a_channel_that_the_bundle_lacks_is_refused():
    made = policies.contract(BUNDLE)
    unknown = made.inputs[0].model_copy(update={"name": "temperature"})
    error = refused(made.model_copy(update={"inputs": (unknown,)}))
    assert "no channel `temperature`" in error.message


def test_one_error_names_every_difference():
    other = with_task(with_joints(BUNDLE, upper=1.0), name="LiftCup", control_hz=10.0)
    error = refused(policies.contract(BUNDLE), other)
    assert error.message == ("the policy does not fit the task bundle: another task, another embodiment, another rate")
    assert list(error.facts) == ["another task", "another embodiment", "another rate"]


def test_a_channel_that_is_not_there_cannot_be_asked_for():
    here = layout.of_bundle(BUNDLE)
    with pytest.raises(RuleError, match="there is no channel `contact` to learn from") as caught:
        contracts.channel(here, "contact")
    assert "joints" in caught.value.facts["channels"]
    with pytest.raises(RuleError, match="there is no channel `rgb`") as caught:
        contracts.channel(here, "rgb")
    assert caught.value.hint == "give a film, or leave `rgb` out of `inputs`"


def test_the_embodiment_is_names_order_and_limits_and_nothing_else():
    robot = BUNDLE.robot

    def digest(other: TaskBundle | RobotModel) -> str:
        return layout.embodiment(other if isinstance(other, RobotModel) else other.robot)

    assert digest(robot) == digest(robot.model_copy(update={"source": "elsewhere"}))
    others = [with_joints(BUNDLE, upper=1.0), with_joints(BUNDLE, name="elbow"), with_joints(BUNDLE, order=(0, 2, 1))]
    assert len({digest(robot), *(digest(other) for other in others)}) == 4


def test_a_data_set_of_this_task_fits():
    contracts.check_data(BUNDLE, episodes.small().model_copy(update={"embodiment": layout.embodiment(BUNDLE.robot)}))


def test_a_data_set_with_another_action_space_is_refused_with_all_that_differs():
    fitting = episodes.small().model_copy(update={"embodiment": layout.embodiment(BUNDLE.robot)})
    other = fitting.model_copy(
        update={"joint_names": ("a", "b"), "task": "LiftCup", "rate_hz": 50.0, "object_names": ("box",)}
    )
    with pytest.raises(RuleError) as caught:
        contracts.check_data(BUNDLE, other)
    assert caught.value.code == "DXB-B503"
    assert caught.value.message == (
        "the data set does not fit the task bundle: another task, other actions, another rate, other `objects`"
    )
    assert caught.value.facts["other actions"] == (
        "the data set has 2 (a, b), the bundle has 3 (joint_1, joint_2, joint_3)"
    )
