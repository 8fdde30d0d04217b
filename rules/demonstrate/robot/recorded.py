"""demonstrate.recorded: demonstrations that were recorded on a robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import listing
from dextera_build.policy import layout, robot_run
from dextera_build.policy.robot_run import RobotRun
from dextera_build.rule import Context, Options, rule


class RecordedOptions(Options):
    """Options of demonstrate.recorded."""

    even: bool = False
    """Whether joints are those of the times of the commands, evenly in time, for `align.dynamics`; else they are those
    that the policy or operator was given, which with a camera are as old as its picture."""


class RecordedBackend(Protocol):
    """Interface of a backend of demonstrate.recorded."""

    def episodes(
        self, ctx: Context, bundle: TaskBundle, runs: Mapping[str, RobotRun], options: Any
    ) -> dict[str, Episode | str]:
        """Name of each run -> its episode, or why it is none."""
        ...


@rule(version=3, packages=("numpy", "mcap", "mcap-ros2-support"), runs={"bundle": "primitive"})
def recorded(
    ctx: Context[RecordedBackend],
    bundle: TaskBundle,
    runs: File | Folder,
    *,
    options: RecordedOptions | None = None,
) -> Episodes:
    """Return the episodes in recordings of `dxb robot record` and `dxb run`, in the robot's base frame [m, rad].

    One file `.mcap` is one episode. Joints come from encoders, poses from the tracker that published them; forces are
    not known. Actions are the requested targets. Success is that of the task's predicate on the measurements, in the
    model of the twin `bundle`, or the operator's verdict if there is one; failures are kept apart. The world is `real`,
    or the one that a simulated robot states.

    Raises:
        RuleError: There is no recording, none succeeded, or they are of another task, robot, or several worlds.
        ArtifactError: A file is damaged, or was not finished.
    """
    options = options or RecordedOptions()
    found = robot_run.every(runs, bundle)
    if options.even:
        found = {name: robot_run.evenly(run) for name, run in found.items()}
    worlds = {run.about.get("world", "") for run in found.values()}
    ctx.check(len(worlds) == 1, f"the recordings are of several worlds: {listing(sorted(worlds))}")
    here = bundle.model_copy(update={"kind": worlds.pop()})
    made: dict[str, Episode | str] = ctx.backend.episodes(ctx, here, found, ctx.backend_options)
    unusable = [f"{name}: {why}" for name, why in made.items() if isinstance(why, str)]
    if unusable:
        ctx.warn(f"{len(unusable)} of {len(made)} recordings are no episodes: {listing(unusable)}")
    whole = {name: each for name, each in made.items() if isinstance(each, Episode)}
    items = {name: each for name, each in whole.items() if each.success}
    failures = {name: each for name, each in whole.items() if not each.success}
    episodes = layout.gathered(here, items, failures, len(made)).model_copy(update={"tip_names": ()})
    reasons = spelled(episodes.reasons, most=5)
    ctx.check(bool(items), f"none of {len(made)} recordings shows `{bundle.task.name}` done", reasons=reasons)
    ctx.metric("success", 100 * len(items) / len(made), "%")
    ctx.say(f"{len(items)} of {len(made)} recordings of a {here.kind} robot {reasons}".rstrip())
    return episodes
