"""Random starts of tasks do not explode, with the robot holding its position: 200 of each, a thousand if slow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.runtime.environment import Environment
from tests import factories, openarm_tasks, task_bundles
from tests.held_starts import drawn, held
from tests.robots.robot_recipes import built

WIDE = Reset(position_m=0.03, yaw_rad=0.5, clutter_m=0.01, robot_rad=0.01, joint_rad=0.1, dynamics=1.0)


def exploded(environment: Environment, starts: Iterable[Start]) -> list[str]:
    """What went wrong after which start."""
    return [str(each) for each in held(environment, starts) if each.exploded]


@pytest.mark.medium
@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("task", [task_bundles.lift, task_bundles.close])
def test_random_starts_of_a_small_task(task: Callable[..., TaskBundle], count: int) -> None:
    environment = Environment(task(reset=WIDE))
    assert exploded(environment, drawn(environment, count)) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kuka_leap", "openarm_revo1"])
def test_a_thousand_starts_before_a_robot_of_the_paper(name: str, tmp_path: Path) -> None:
    things = {"box": factories.box_asset(factories.pose(0.1)), "bowl": factories.bowl_asset(factories.pose(0.1, 0.25))}
    base = openarm_tasks.BASE if name == "openarm_revo1" else factories.pose(-0.6)
    robot = built(name, tmp_path)
    environment = Environment(openarm_tasks.bundle(robot, LiftGoal(height_m=0.1), things, "box", base=base))
    assert exploded(environment, drawn(environment)) == []


def test_an_explosion_is_found() -> None:
    """A thing that begins inside the table is thrown out of it."""
    environment = Environment(task_bundles.lift(reset=WIDE))
    start = environment.draw(0)
    qpos = start.qpos.copy()
    qpos[2] -= 0.02
    (line,) = exploded(environment, [start.model_copy(update={"qpos": qpos})])
    assert line.startswith("0: ")
