"""capture.mount: the truth with the declared error, and nothing without a robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.world import World
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.testing import RuleRunner
from tests import reference_tasks
from tests.rules.capture.cameras import CAMERA


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    options = {"camera": CAMERA, "objects": {}, "lamps": (), "robot": reference_tasks.STAND}
    made: World = RuleRunner(tmp_path_factory.mktemp("world")).run("capture.world", options=options)
    return made


def mount(folder: Path, world: World, **options: float) -> np.ndarray:
    found = RuleRunner(folder).run("capture.mount", options=options, world=world, robot=reference_tasks.robot())
    assert (found.parent, found.child) == ("camera", "base")
    matrix: np.ndarray = found.matrix
    return matrix


def test_without_an_error_it_is_the_truth(world: World, tmp_path: Path) -> None:
    found = world.camera_pose.matrix @ mount(tmp_path, world, position_sigma_m=0.0, rotation_sigma_deg=0.0)
    np.testing.assert_allclose(found[:3, 3], reference_tasks.STAND["position_m"], atol=1e-12)
    angle = np.radians(190.0)
    np.testing.assert_allclose(found[:3, 0], [np.cos(angle), np.sin(angle), 0.0], atol=1e-12)
    np.testing.assert_allclose(found[:3, 2], [0.0, 0.0, 1.0], atol=1e-12)


def test_errors_have_the_declared_size(world: World, tmp_path: Path) -> None:
    truth = mount(tmp_path, world, position_sigma_m=0.0, rotation_sigma_deg=0.0)
    found = [mount(tmp_path, world, seed=seed) for seed in range(200)]
    shifts = np.array([pose[:3, 3] - truth[:3, 3] for pose in found])
    turns = np.array([transforms.angle(truth[:3, :3].T @ pose[:3, :3]) for pose in found])
    assert shifts.std() == pytest.approx(0.001, rel=0.1)
    # The length of three normal errors has the mean square 3 sigma^2.
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(np.sqrt(3) * np.radians(0.1), rel=0.1)


def test_a_seed_is_a_draw(world: World, tmp_path: Path) -> None:
    np.testing.assert_array_equal(mount(tmp_path, world, seed=3), mount(tmp_path, world, seed=3))
    assert not np.array_equal(mount(tmp_path, world, seed=3), mount(tmp_path, world, seed=4))


def test_without_a_robot_nothing_is_found(world: World, tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="this world has no robot") as error:
        mount(tmp_path, world.model_copy(update={"stand": None}))
    assert error.value.hint
    robot = reference_tasks.robot().model_copy(update={"links": {"foot": "arm"}})
    with pytest.raises(RuleError, match="the robot has no body `base`"):
        RuleRunner(tmp_path).run("capture.mount", world=world, robot=robot)
