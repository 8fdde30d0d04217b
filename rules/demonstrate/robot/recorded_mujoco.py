"""demonstrate.recorded in MuJoCo, which places robot and objects as they were measured."""

from __future__ import annotations

from collections.abc import Mapping

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.robot_run import RobotRun
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime import measured_run

BACKEND = Backend(summary="MuJoCo, without dynamics", profiles=("cpu",), packages=("mujoco",), extra="twin")


def episodes(
    ctx: Context, bundle: TaskBundle, runs: Mapping[str, RobotRun], options: Options
) -> dict[str, Episode | str]:
    """Name of each run -> its episode, or why it is none."""
    made = {name: measured_run.attempt(bundle, run) for name, run in runs.items()}
    return {name: each.episode or each.excluded for name, each in made.items()}
