"""align.robot_camera on rendered captures: from a coarse calibration to a hand in its place."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.cameras.camera import Measured
from dextera_build.artifacts.cameras.image import DepthImage
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, transforms
from dextera_build.sim.model import forward
from dextera_build.testing import RuleRunner
from tests.rules.reference.posed import worlds


@cache
def views(folder: Path, **options: float) -> RobotViews:
    found = RuleRunner(folder).run(
        "reference.robot_views",
        world=worlds.world(),
        robot=worlds.robot(),
        options={**worlds.SMALL, "count": 6, "errors": options},
    )
    assert isinstance(found, RobotViews)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("views")


def coarse(shift: tuple[float, float, float] = (0.012, -0.009, 0.008), turn_deg: float = 0.8) -> Calibration:
    """The true calibration with an error."""
    error = transforms.rigid(lie.rotation(np.radians(turn_deg) * np.array([0.6, -0.6, 0.5])), np.array(shift))
    return Calibration(mount="eye_on_base", pose=Pose(parent="base", child="camera", matrix=worlds.truth() @ error))


def hand_error(views: RobotViews, found: Calibration) -> float:
    """Mean distance [mm] of the palm by joints and calibration from where it is."""
    assert views.joints is not None
    frames = forward.frames(worlds.robot(), views.joints.names, views.joints.positions, "palm")
    right, ours = transforms.invert(worlds.truth()), transforms.invert(found.pose.matrix)
    places = frames[:, :3, 3]
    return 1000 * float(np.linalg.norm(transforms.apply(right, places) - transforms.apply(ours, places), axis=1).mean())


@pytest.mark.slow
def test_a_coarse_calibration_is_refined(folder: Path, tmp_path: Path) -> None:
    taken, start, runner = views(folder), coarse(), RuleRunner(tmp_path)
    found = runner.run("align.robot_camera", views=taken, robot=worlds.robot(), calibration=start)
    assert hand_error(taken, start) > 10
    assert hand_error(taken, found) < 1.5
    assert found.method == "unstated, balanced ICP"
    sigma = found.pose.sigma()
    assert sigma is not None
    assert 0.0005 < sigma[0] < 0.01
    gap = transforms.invert(worlds.truth()) @ found.pose.matrix
    error = np.concatenate(
        [
            found.pose.matrix[:3, 3] - worlds.truth()[:3, 3],
            found.pose.matrix[:3, :3] @ lie.rotation_vector(gap[:3, :3]),
        ]
    )
    assert error @ np.linalg.solve(found.pose.covariance, error) < 25
    assert [caption for caption, _ in runner.outcome.previews] == [
        "outline of the model: arm (green), hand (orange)",
        "residuals of arm (blue) and hand (orange)",
    ]


@pytest.mark.slow
def test_what_something_hides_is_left_out(folder: Path, tmp_path: Path) -> None:
    """As the edge of a table that stands before the robot's foot."""
    taken, captures = views(folder), {}
    for name, capture in taken.captures.items():
        assert capture.measured is not None
        depth = capture.measured.depth.depth.copy()
        depth[270:] = 0.8
        captures[name] = capture.model_copy(update={"measured": Measured(depth=DepthImage(depth=depth))})
    hidden, runner = taken.model_copy(update={"captures": captures}), RuleRunner(tmp_path)
    found = runner.run("align.robot_camera", views=hidden, robot=worlds.robot(), calibration=coarse())
    assert hand_error(taken, found) < 1.5
    assert runner.outcome.metrics["arm residual"][0] < 2.0


@pytest.mark.slow
def test_markers_then_the_robot_itself(folder: Path, tmp_path: Path) -> None:
    """The whole chain: world, views, hand-eye, robot."""
    taken, runner = views(folder), RuleRunner(tmp_path)
    marked = runner.run("align.hand_eye", views=taken, robot=worlds.robot())
    found = runner.run("align.robot_camera", views=taken, robot=worlds.robot(), calibration=marked)
    assert hand_error(taken, marked) < 4
    assert hand_error(taken, found) < 1.5
    assert found.board_pose is not None


@pytest.mark.medium
def test_a_wrong_calibration_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="the robot is not where the calibration has it"):
        RuleRunner(tmp_path).run(
            "align.robot_camera", views=views(folder), robot=worlds.robot(), calibration=coarse((0.3, 0.2, 0.1), 10.0)
        )


@pytest.mark.slow
def test_degrees_and_unknown_joints_are_refused(folder: Path, tmp_path: Path) -> None:
    taken = views(folder)
    assert taken.joints is not None
    degrees = taken.joints.model_copy(update={"positions": np.degrees(taken.joints.positions)})
    for rule, more in (("align.robot_camera", {"calibration": coarse()}), ("align.hand_eye", {})):
        with pytest.raises(RuleError, match="the positions look like degrees"):
            RuleRunner(tmp_path).run(
                rule, views=taken.model_copy(update={"joints": degrees}), robot=worlds.robot(), **more
            )
        other = taken.joints.model_copy(update={"names": ("turn", "lean", "roll", "elbow")})
        with pytest.raises(RuleError, match="the robot has no joint `elbow`"):
            RuleRunner(tmp_path).run(
                rule, views=taken.model_copy(update={"joints": other}), robot=worlds.robot(), **more
            )


@pytest.mark.medium
def test_joints_in_a_wrong_order_are_refused(folder: Path, tmp_path: Path) -> None:
    taken = views(folder)
    assert taken.joints is not None
    names = taken.joints.names
    swapped = taken.joints.model_copy(update={"names": (names[3], names[1], names[2], names[0])})
    with pytest.raises(RuleError, match="contradict each other") as caught:
        RuleRunner(tmp_path).run(
            "align.hand_eye", views=taken.model_copy(update={"joints": swapped}), robot=worlds.robot()
        )
    assert "order of the joints" in str(caught.value.hint)


def test_pictures_without_depth_are_refused(folder: Path, tmp_path: Path) -> None:
    taken = views(folder)
    flat = {name: each.model_copy(update={"measured": None}) for name, each in taken.captures.items()}
    with pytest.raises(RuleError, match="6 of 6 pictures have no depth"):
        RuleRunner(tmp_path).run(
            "align.robot_camera",
            views=taken.model_copy(update={"captures": flat}),
            robot=worlds.robot(),
            calibration=coarse(),
        )


def test_the_stub_keeps_the_calibration(folder: Path, tmp_path: Path) -> None:
    found = RuleRunner(tmp_path).run(
        "align.robot_camera",
        profile="stub",
        backend="stub",
        views=views(folder),
        robot=worlds.robot(),
        calibration=coarse(),
    )
    np.testing.assert_allclose(found.pose.matrix, coarse().pose.matrix, atol=1e-12)
