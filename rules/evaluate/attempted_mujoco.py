"""evaluate.attempted in MuJoCo, which places robot and objects as they were measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.policy.robot_run import RobotRun
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime import measured_run

BACKEND = Backend(summary="MuJoCo, without dynamics", profiles=("cpu",), packages=("mujoco",), extra="twin")


def judged(
    ctx: Context, bundle: TaskBundle, runs: Mapping[str, RobotRun], options: Options
) -> Iterator[tuple[str, Attempt]]:
    """Name and attempt of each run, in order."""
    for number, (name, run) in enumerate(runs.items()):
        yield name, measured_run.attempt(bundle, run, trusts=True)
        ctx.progress(number + 1, len(runs), "recordings")
