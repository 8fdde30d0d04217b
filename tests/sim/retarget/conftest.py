"""The robots of the shipped recipes, built once for a session of these tests."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from tests.robots.robot_recipes import built


@pytest.fixture(scope="session")
def leap(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return built("kuka_leap", tmp_path_factory.mktemp("leap"))


@pytest.fixture(scope="session")
def revo(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return built("openarm_revo1", tmp_path_factory.mktemp("revo"))


@pytest.fixture(scope="session")
def revo2(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return built("openarm_revo2", tmp_path_factory.mktemp("revo2"))


@pytest.fixture(params=["leap arm", "revo left", "revo right", "revo2 right"])
def hand(request: pytest.FixtureRequest) -> tuple[RobotModel, str]:
    """A robot and a limb."""
    robot, limb = request.param.split()
    return request.getfixturevalue(robot), limb
