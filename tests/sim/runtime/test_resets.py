"""Random starts of tasks do not explode: a thousand of each, simulated with the robot holding its position."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.episode import Start
from dextera_build.artifacts.goals import LiftGoal
from dextera_build.artifacts.task import Reset, TaskBundle
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.worlds import settle
from tests import factories, openarm_tasks, task_bundles
from tests.robots.robot_recipes import built

WIDE = Reset(position_m=0.03, yaw_rad=0.5, clutter_m=0.01, robot_rad=0.01, joint_rad=0.1, dynamics=1.0)
HELD_S = 0.1
FASTEST_M_S = 0.3
"""Nothing may be faster: a fall by 4 mm."""
DEEPEST_M = 0.002


def exploded(environment: Environment, starts: Iterable[Start]) -> list[str]:
    """What went wrong after which start."""
    bundle, found = environment.bundle, []
    roots = {int(environment.model.body(name).id) for name in bundle.objects}
    for start in starts:
        environment.begin(start)
        fastest = deepest = 0.0
        for _ in range(max(1, round(HELD_S / environment.period_s))):
            outcome = environment.step(environment.previous_action)
            data, depths = environment.data, settle.penetrations(environment.model, environment.data)
            fastest = max(fastest, *(float(np.linalg.norm(data.cvel[root, 3:])) for root in roots))
            deepest = max(deepest, *(depths.get(root, 0.0) for root in roots))
        if outcome.reason == "the simulation diverged" or not np.isfinite(data.qpos).all():
            found.append(f"{start.seed}: diverged")
        elif fastest > FASTEST_M_S or deepest > DEEPEST_M:
            found.append(f"{start.seed}: {fastest:.2f} m/s, {1000 * deepest:.2f} mm deep")
    return found


def drawn(environment: Environment) -> Iterable[Start]:
    """A thousand random starts."""
    return (environment.draw(seed) for seed in range(1000))


@pytest.mark.parametrize("task", [task_bundles.lift, task_bundles.close])
def test_a_thousand_starts_of_a_small_task(task: Callable[..., TaskBundle]) -> None:
    environment = Environment(task(reset=WIDE))
    assert exploded(environment, drawn(environment)) == []


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
