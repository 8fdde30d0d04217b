"""A task that live sessions of tests do."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.testing import RuleRunner
from tests import hand_tasks
from tests.robots.robot_recipes import built


@pytest.fixture(scope="package")
def runner(tmp_path_factory: pytest.TempPathFactory) -> RuleRunner:
    return RuleRunner(tmp_path_factory.mktemp("rules"))


@pytest.fixture(scope="package")
def lifting(runner: RuleRunner, tmp_path_factory: pytest.TempPathFactory) -> TaskBundle:
    return hand_tasks.lift_can(runner, built("kuka_leap", tmp_path_factory.mktemp("robot")), [])
