"""simulate.cell: what a tracker knows, where its camera is believed to stand, and where it does."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.scenes.world import RobotStand, World
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.testing import RuleRunner
from tests import factories

LENS = Camera(width=1280, height=720, fx=912.0, fy=912.0, cx=643.0, cy=361.0)
EYE = factories.look_at((0.0, -0.8, 0.7))
"""T_world_camera of the photograph."""
BASE = factories.pose(0.1, 0.5, 0.0, yaw=-1.5)
"""T_world_base."""


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def scene(lens: Camera = LENS) -> Scene:
    return Scene(model=Folder(files={}), camera=lens, camera_pose=factories.placed(EYE, "camera"), bodies=("box",))


def assets() -> Collection[Asset]:
    return Collection[Asset](items={"box": factories.box_asset(), "note book": factories.laptop_asset()})


def world(lens: Camera = LENS, stand: bool = True) -> World:
    """Another frame than the twin's; its robot and camera stand about as in the twin."""
    place = RobotStand(position=(0.4, 0.1, 0.0), yaw=0.7, joints={})
    camera = place.pose().matrix @ transforms.invert(BASE) @ EYE @ factories.pose(0.003, -0.002, 0.001, yaw=0.004)
    return World(
        objects={},
        fixtures={},
        lamps=(),
        ambient=0.5,
        stand=place if stand else None,
        camera=lens,
        camera_pose=factories.placed(camera, "camera", "reference"),
    )


def made(runner: RuleRunner, *, options: dict[str, object] | None = None, **changed: object):
    given = {"scene": scene(), "assets": assets(), "base": factories.placed(BASE, "base")}
    return runner.run("simulate.cell", options=options, **(given | changed))


def test_the_true_camera_is_that_of_the_world_and_the_calibration_s_error_is_told(runner):
    mount = factories.placed(transforms.invert(EYE) @ BASE, "base", "camera")
    found = made(runner, measured=mount, world=world())
    assert found.mount.matrix == pytest.approx(mount.matrix)
    place = world().stand
    assert found.eye.matrix == pytest.approx(transforms.invert(place.pose().matrix) @ world().camera_pose.matrix)
    assert (found.eye.parent, found.eye.child) == ("base", "camera")
    assert runner.outcome.metrics["error of the calibration, position"][0] == pytest.approx(np.sqrt(14.0), abs=1e-6)
    assert runner.outcome.metrics["error of the calibration, rotation"][0] == pytest.approx(np.degrees(0.004))
    assert "3.7 mm and 0.23 deg off; simulated" in runner.outcome.line


def test_frames_are_as_the_photograph_cropped(runner):
    found = made(runner)
    assert (found.camera.width, found.camera.height) == (640, 480)
    assert found.camera.fx == pytest.approx(608.0)
    assert found.placed(transforms.invert(EYE) @ BASE) == pytest.approx(np.eye(4), abs=1e-9)
    assert set(found.assets) == {"box", "note_book"}


def test_without_a_world_the_error_is_drawn(runner):
    draws = [made(runner, options={"seed": seed, "error_m": 0.004, "error_deg": 0.5}) for seed in range(40)]
    off = [each.mount.matrix @ each.eye.matrix for each in draws]
    assert np.std([matrix[:3, 3] for matrix in off]) == pytest.approx(0.004, rel=0.6)
    angles = [transforms.angle(matrix[:3, :3]) for matrix in off]
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(np.radians(0.5) * np.sqrt(3), rel=0.25)
    same = made(runner, options={"seed": 3, "error_m": 0.004, "error_deg": 0.5})
    assert same.eye.matrix == pytest.approx(draws[3].eye.matrix)
    exact = made(runner, options={"error_m": 0.0, "error_deg": 0.0})
    assert exact.mount.matrix @ exact.eye.matrix == pytest.approx(np.eye(4), abs=1e-9)


def test_a_covariance_that_is_known_is_that_of_the_error(runner):
    mount = factories.placed(transforms.invert(EYE) @ BASE, "base", "camera")
    narrow = mount.model_copy(update={"covariance": np.diag([1e-12] * 6)})
    found = made(runner, measured=narrow, options={"error_m": 0.1})
    assert found.mount.matrix @ found.eye.matrix == pytest.approx(np.eye(4), abs=1e-4)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"measured": factories.placed(BASE, "base")}, "the calibration is T_world_base, but T_camera_base is needed"),
        ({"world": world(stand=False)}, "this world has no robot"),
        (
            {"world": world(LENS.scaled(0.5))},
            "the camera of the world is not the one that photographed the twin",
        ),
    ],
)
def test_what_does_not_belong_together_is_refused(runner, changed, message):
    with pytest.raises(RuleError) as caught:
        made(runner, **changed)
    assert caught.value.message == message
