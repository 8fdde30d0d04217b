"""evaluate.attempted: trials from recordings of runs on a robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.trials import Actor, Attempt, Trials
from dextera_build.errors import listing
from dextera_build.policy import robot_run
from dextera_build.policy.robot_run import RobotRun
from dextera_build.rule import Context, Options, rule

from .protocol import Record, close


class AttemptedOptions(Options):
    """Options of evaluate.attempted."""

    label: str = ""
    """Name of the policy in tables; empty: its algorithm, `ACT`."""


class AttemptedBackend(Protocol):
    """Interface of a backend of evaluate.attempted."""

    def judged(
        self, ctx: Context, bundle: TaskBundle, runs: Mapping[str, RobotRun], options: Any
    ) -> Iterator[tuple[str, Attempt]]:
        """Name and attempt of each run, in order."""
        ...


@rule(version=3, packages=("numpy", "mcap", "mcap-ros2-support"), runs={"bundle": "primitive"})
def attempted(
    ctx: Context[AttemptedBackend], bundle: TaskBundle, runs: File | Folder, *, options: AttemptedOptions
) -> Trials:
    """Return the trials in recordings of `dxb run`, one file `.mcap` each, in the order of their names.

    A trial is judged by the task's own predicate from what was measured, in the model of the twin `bundle`. If the
    operator gave a verdict, that one counts; both are kept. Where objects were not measured at all times, the
    operator's verdict alone judges; such runs without one, and runs in which nothing was sent, are left out. The world
    is `real`, or the one that a simulated robot states.

    Raises:
        RuleError: There is no recording, or they are of another task or robot, of several policies, or worlds.
        ArtifactError: A file is damaged, or was not finished.
    """
    found = robot_run.every(runs, bundle)
    about = {fact: _one(ctx, fact, found) for fact in ("policy", "algorithm", "world", "origin")}
    actor: Actor = "replay" if about["origin"] == "replay" else "policy"
    ctx.check(about["origin"] == actor, "the recordings are demonstrations", hint="`demonstrate.recorded` reads them")
    record = Record(bundle.model_copy(update={"kind": about["world"]}), "tracked")
    attempts: Iterator[tuple[str, Attempt]] = ctx.backend.judged(ctx, record.bundle, found, ctx.backend_options)
    overruled = 0
    for name, attempt in attempts:
        examples = dict(record.examples)
        record.add(attempt)
        if not found[name].complete:
            record.examples = examples  # where its objects were is not known
        overruled += attempt.episode is not None and found[name].operator is not None
        ctx.log(f"{name}: {_outcome(attempt, found[name].operator)}")
    close(ctx, record)
    verdicts = [trial.verdicts for trial in record.items if trial.verdicts and trial.verdicts.operator is not None]
    ctx.metric("judged by the operator", overruled, f"of {len(record.items)}")
    if verdicts:
        same = sum(each.measured == each.operator for each in verdicts)
        ctx.metric("same verdict from measurements", same, f"of {len(verdicts)}")
    label = options.label or about["algorithm"].upper() or actor
    made = record.trials(actor, label=label, source=about["policy"], algorithm=about["algorithm"])
    # Forces on fingertips are not measured.
    return made.model_copy(update={"examples": made.examples.model_copy(update={"tip_names": ()})})


def _one(ctx: Context, fact: str, runs: Mapping[str, RobotRun]) -> str:
    """A fact that must be the same in all recordings."""
    values = {name: run.about.get(fact, "") for name, run in runs.items()}
    ctx.check(
        len(set(values.values())) == 1,
        f"the recordings differ in `{fact}`",
        found=listing(f"{name}: {value[:12]}" for name, value in values.items()),
        hint="give the runs of one policy in one world as a folder of their own",
    )
    return next(iter(values.values()))


def _outcome(attempt: Attempt, operator: bool | None) -> str:
    if attempt.episode is None:
        return attempt.excluded
    said = "" if operator is None else ", by the operator"
    return ("success" if attempt.episode.success else attempt.episode.reason) + said
