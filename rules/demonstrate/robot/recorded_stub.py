"""demonstrate.recorded without a model: every recording is a success."""

from __future__ import annotations

from collections.abc import Mapping

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.robot_run import RobotRun
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

BACKEND = Backend(summary="nothing is judged: every recording is a success", profiles=("stub",))


def episodes(
    ctx: Context, bundle: TaskBundle, runs: Mapping[str, RobotRun], options: Options
) -> dict[str, Episode | str]:
    """Name of each run -> its episode, or why it is none."""
    return {name: fake_trial(bundle, number, "operator", success=True) for number, name in enumerate(runs)}
