"""reference.robot_views: pictures of a robot that holds a board, and what its encoders read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.errors import RuleError
from dextera_build.geometry import robot_mask, transforms
from dextera_build.sim.model import forward
from dextera_build.sim.render.robot_view import RobotRenderer
from dextera_build.testing import RuleRunner
from rules.align.calibration import detection
from tests.rules.reference.posed import worlds


def taken(tmp_path: Path, **options: object) -> RobotViews:
    found = RuleRunner(tmp_path).run(
        "reference.robot_views",
        world=worlds.world(),
        robot=worlds.robot(),
        options={**worlds.SMALL, "count": 3, **options},
    )
    assert isinstance(found, RobotViews)
    return found


@pytest.mark.medium
def test_board_and_depth_are_where_the_joints_say(tmp_path: Path) -> None:
    exact = {"errors": {"encoder_sigma_deg": 0.0}, "depth_noise": {"subpixel_px": 0.0}}
    views = taken(tmp_path, **exact)
    assert views.joints is not None
    assert views.board is not None
    camera_base = transforms.invert(worlds.truth())
    camera = worlds.world().camera
    flange = forward.frames(worlds.robot(), views.joints.names, views.joints.positions, "flange")
    plate = transforms.rigid(
        np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]).astype(float), np.array([-0.0945, -0.05, -0.08])
    )
    renderer = RobotRenderer(worlds.robot(), camera)
    for number, capture in enumerate(views.captures.values()):
        seen = detection.look(capture.photograph.rgb.pixels, camera.matrix(), views.board, "edges").sighting
        assert seen is not None
        corners = camera.project(transforms.apply(camera_base @ flange[number] @ plate, seen.board))
        assert np.sqrt(((corners - seen.pixels) ** 2).sum(axis=1).mean()) < 0.3
        assert capture.measured is not None
        joints = dict(zip(views.joints.names, views.joints.positions[number].tolist(), strict=True))
        drawn = renderer.view(joints, camera_base)
        inner = robot_mask.inner(drawn.labels, drawn.depth) & (capture.measured.depth.depth > 0)
        off = capture.measured.depth.depth[inner] - drawn.depth[inner]
        assert abs(np.median(off)) < 0.0008  # the plate hides a part


def test_a_biased_arm_is_larger_than_its_model(tmp_path: Path) -> None:
    from dextera_build.sim.worlds.posed import biased

    longer = biased(worlds.robot(), 0.0, 0.02)
    where = [forward.frames(each, ("turn",), np.zeros((1, 1)), "flange")[0, :3, 3] for each in (worlds.robot(), longer)]
    assert where[1][2] == pytest.approx(0.03 + 1.02 * (where[0][2] - 0.03))
    plain = RobotRenderer(worlds.robot(), worlds.world().camera).view({}, transforms.invert(worlds.truth()))
    wide = RobotRenderer(biased(worlds.robot(), 0.1, 0.0), worlds.world().camera).view(
        {}, transforms.invert(worlds.truth())
    )
    assert (wide.labels == 1).sum() > 1.08 * (plain.labels == 1).sum()
    assert (wide.labels == 2).sum() == pytest.approx((plain.labels == 2).sum(), rel=0.1)


@pytest.mark.slow
def test_encoders_err_as_stated_and_seeds_differ(tmp_path: Path) -> None:
    exact = taken(tmp_path, errors={"encoder_sigma_deg": 0.0})
    noisy = taken(tmp_path, errors={"encoder_sigma_deg": 0.0, "zero_sigma_deg": 0.5})
    other = taken(tmp_path, seed=5)
    assert exact.joints is not None
    assert noisy.joints is not None
    assert other.joints is not None
    off = noisy.joints.positions - exact.joints.positions
    np.testing.assert_allclose(off, np.broadcast_to(off[:1], off.shape), atol=1e-12)
    assert 0.001 < np.abs(off).max() < 0.04
    assert np.abs(other.joints.positions - exact.joints.positions).max() > 0.05


def test_the_stub_needs_no_renderer(tmp_path: Path) -> None:
    found = RuleRunner(tmp_path).run(
        "reference.robot_views", profile="stub", backend="stub", world=worlds.world(), robot=worlds.robot()
    )
    assert len(found.captures) == 10


def test_a_world_without_a_robot_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="this world has no robot"):
        RuleRunner(tmp_path).run(
            "reference.robot_views", world=worlds.world().model_copy(update={"stand": None}), robot=worlds.robot()
        )
