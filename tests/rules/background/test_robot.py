"""background.robot: a calibrated robot is where its model says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Measured
from dextera_build.artifacts.cameras.image import DepthImage, LabelImage
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.errors import RuleError
from dextera_build.geometry import raycast
from dextera_build.testing import RuleRunner
from tests import factories

LENS = factories.camera(320, 240)
CAMERA = factories.look_at((0.0, -1.5, 0.6), (0.0, 0.0, 0.4))
"""T_base_camera; the base is where the robot's own model has it not."""
MODEL = """
<mujoco>
  <worldbody>
    <body name="base" pos="3 1 2">
      <geom type="box" size="0.1 0.1 0.05" pos="0 0 0.05"/>
      <body name="arm" pos="0 0 0.1">
        <joint name="turn" type="hinge" axis="0 1 0"/>
        <geom type="box" size="0.03 0.03 0.2" pos="0 0 0.2"/>
        <geom type="box" size="0.5 0.5 0.5" pos="0 0 0.2" group="3"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def robot() -> RobotModel:
    turn = RobotJoint(name="turn", group="arm", lower=-2.0, upper=2.0, velocity=1.0, effort=1.0, home=0.0)
    files = Folder(files={"robot.xml": MODEL.encode()})
    return RobotModel(model=files, joints=(turn,), links={"base": "arm", "arm": "arm"}, frames={}, source="hand-made")


def seen(tmp_path: Path, backend: str = "mujoco", **options: object) -> np.ndarray:
    mount = factories.placed(np.linalg.inv(CAMERA), "base", "camera")
    found = RuleRunner(tmp_path).run(
        "background.robot", backend=backend, options=options, robot=robot(), camera=LENS, mount=mount
    )
    assert isinstance(found, LabelImage)
    return np.asarray(found.labels > 0)


def truth(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    boxes = [factories.box_mesh((-0.1, -0.1, 0.0), (0.1, 0.1, 0.1)), factories.box_mesh(low, high)]
    surfaces = [raycast.Surface(box.vertices, box.faces) for box in boxes]
    return np.asarray(raycast.render(surfaces, LENS.matrix(), CAMERA, LENS.height, LENS.width).index >= 0)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def test_the_robot_is_where_its_calibration_and_encoders_say(tmp_path: Path) -> None:
    upright, aside = truth((-0.03, -0.03, 0.1), (0.03, 0.03, 0.5)), truth((0.0, -0.03, 0.07), (0.4, 0.03, 0.13))
    assert overlap(seen(tmp_path), upright) > 0.95
    turned = seen(tmp_path, joints_deg={"turn": 90.0})
    assert overlap(turned, aside) > 0.95
    assert overlap(turned, upright) < 0.7


def test_the_stub_sees_none(tmp_path: Path) -> None:
    assert not seen(tmp_path, "stub").any()


def test_an_unknown_joint_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="no joint `elbow`"):
        seen(tmp_path, joints_deg={"elbow": 3.0})


def test_measured_depth_corrects_the_outline(tmp_path: Path) -> None:
    """The calibration is 2 cm off: the model's outline is beside the robot, the measured depth is not."""
    real = [
        factories.box_mesh((-0.1, -0.1, 0.0), (0.1, 0.1, 0.1)),
        factories.box_mesh((-0.03, -0.03, 0.1), (0.03, 0.03, 0.5)),
    ]
    wall = factories.box_mesh((-3.0, 0.6, -1.0), (3.0, 0.7, 3.0))
    surfaces = [raycast.Surface(each.vertices, each.faces) for each in (*real, wall)]
    shot = raycast.render(surfaces, LENS.matrix(), CAMERA, LENS.height, LENS.width)
    robots_own = (shot.index == 0) | (shot.index == 1)
    wrong = np.linalg.inv(CAMERA)
    wrong[0, 3] += 0.02
    mount = factories.placed(wrong, "base", "camera")
    found = {}
    for name, more in (
        ("plain", {}),
        ("measured", {"measured": Measured(depth=DepthImage(depth=shot.depth.astype(np.float32)))}),
    ):
        label = RuleRunner(tmp_path).run("background.robot", robot=robot(), camera=LENS, mount=mount, **more)
        found[name] = overlap(label.labels > 0, robots_own)
    assert found["plain"] < 0.85
    assert found["measured"] > 0.97
