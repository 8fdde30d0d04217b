"""Shared code of rollouts and replays: start seeds, the record of every trial, and the summary line."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.reasons import spelled, tally
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Actor, Attempt, Poses, Sighting, Trial, Trials
from dextera_build.errors import listing
from dextera_build.policy.layout import embodiment, gathered
from dextera_build.rule import ROUNDING, Context, Tolerance
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.statistics import Rate

TOLERANCE = Tolerance(
    {"": ROUNDING, "items": math.inf, "examples": math.inf, "excluded": math.inf},
    metrics={"success": 10.0, "progress": 10.0},
)
"""Contacts amplify rounding differences, so a trial may end differently on another processor; most do not."""


def seeds(seed: int, count: int) -> list[int]:
    """Seeds of the starts; the i-th depends only on `seed` and i, so all policies face the same starts."""
    return [seed_of("trial", seed, number) for number in range(count)]


@dataclass
class Record:
    """Records the trials of one actor in one world.

    Args:
        bundle: The world.
        poses: Source of the actor's object poses.
        terms: Recorded terms that do not come with dxb.
        stopped: Whether the results decide when the trials end.
    """

    bundle: TaskBundle
    poses: Poses = "exact"
    terms: tuple[TermSpec, ...] = ()
    stopped: bool = False
    items: list[Trial] = field(default_factory=list)
    placed: list[np.ndarray] = field(default_factory=list)
    excluded: Counter[str] = field(default_factory=Counter)
    examples: dict[bool, tuple[int, Attempt]] = field(default_factory=dict)

    def add(self, attempt: Attempt) -> None:
        """Add an attempt; the first success and the first failure are kept complete."""
        episode = attempt.episode
        if episode is None or attempt.placed is None:
            self.excluded[attempt.excluded] += 1
            return
        self.examples.setdefault(episode.success, (len(self.items), attempt))
        self.placed.append(attempt.placed)
        self.items.append(
            Trial(
                seed=attempt.seed,
                start=digest_of(episode.start),
                success=episode.success,
                reason=episode.reason,
                steps=len(episode.action),
                stage=len(self.stages) if episode.success else attempt.stage,
                sighting=attempt.sighting,
                verdicts=attempt.verdicts,
            )
        )

    @property
    def rate(self) -> Rate:
        """Successes so far."""
        return Rate(sum(trial.success for trial in self.items), len(self.items), self.stopped)

    @property
    def stages(self) -> tuple[str, ...]:
        """Steps on the way to success, the last one included."""
        return (*catalogue.kind(self.bundle.task.primitive).stages, "success")

    @property
    def progress(self) -> Rate:
        """Sum of the fractions of stages that the trials reached."""
        return Rate(sum(trial.stage for trial in self.items) / len(self.stages), len(self.items))

    def trials(self, actor: Actor, *, label: str, source: Artifact | str, algorithm: str = "") -> Trials:
        """Return the recorded trials as an artifact; `source` is what acted, or its digest."""
        return Trials(
            actor=actor,
            label=label,
            algorithm=algorithm,
            source=source if isinstance(source, str) else digest_of(source),
            task=self.bundle.task,
            embodiment=embodiment(self.bundle.robot),
            robot=robot_name(self.bundle),
            world=self.bundle.kind,
            poses=self.poses,
            stages=self.stages,
            stopped=self.stopped,
            items=tuple(self.items),
            placed=np.array(self.placed, np.float32).reshape(len(self.items), len(self.bundle.objects), 7),
            excluded=dict(self.excluded),
            examples=self.kept(),
        )

    def kept(self) -> Episodes:
        """The kept examples, readable without the task's model."""
        kept = {
            success: {str(number): attempt.episode}
            for success, (number, attempt) in self.examples.items()
            if attempt.episode is not None
        }
        return gathered(self.bundle, kept.get(True, {}), kept.get(False, {}), len(self.items), self.terms)


def policy_label(contract: PolicyContract) -> str:
    """Name of a policy in tables: `ACT`, or `ACT image` for a policy on pictures."""
    return contract.algorithm.upper() + (" image" if contract.sees else "")


def same_task(ctx: Context, twin: TaskBundle, world: TaskBundle) -> None:
    """Fail if two bundles are not one task in two worlds."""
    if twin.task != world.task or list(twin.objects) != list(world.objects):
        ctx.fail(
            f"`twin` is another task than `{world.task.name}` of the world",
            twin=f"{twin.task.name} with {listing(twin.objects)}",
            hint="give the task that the world was made for",
        )


def close(ctx: Context, record: Record, of: str = "") -> None:
    """Report the result; fail on a record without trials. `of` names its actor in metrics if there are several."""
    ctx.check(
        bool(record.items),
        f"no trial of `{record.bundle.task.name}` came about",
        **({"reasons": spelled(record.excluded, most=3)} if record.excluded else {}),
        hint="make the ranges of `reset` smaller, or look at the demonstrations",
    )
    rate, without = record.rate, sum(record.excluded.values())
    low, high = rate.interval()
    shares = {"success": rate.value, "success, low": low, "success, high": high, "progress": record.progress.value}
    for what, share in shares.items():
        ctx.metric(f"{of}: {what}" if of else what, 100 * share, "%")
    if without:
        ctx.metric("without a trial", without, f"of {len(record.items) + without}")
    how = ", poses tracked" if record.poses == "tracked" else ""
    place = "real world" if record.bundle.kind == "real" else record.bundle.kind
    ctx.say(f"{rate} in the {place}{how}" + (f", {without} starts left out" if without else ""))
    _tell(ctx, [(trial.success, trial.sighting) for trial in record.items if trial.sighting is not None])
    for reason, count in tally(trial.reason for trial in record.items if not trial.success).items():
        ctx.log(f"{count} x {reason}")
    stages = ("no stage", *record.stages)
    for stage, count in Counter(stages[trial.stage] for trial in record.items if not trial.success).most_common():
        ctx.log(f"{count} x failed after: {stage}")
    for reason, count in record.excluded.most_common():
        ctx.log(f"{count} x left out: {reason}")


def _tell(ctx: Context, trials: Sequence[tuple[bool, Sighting]]) -> None:
    """Report the accuracy of a tracker over all trials, compared with their true success; nothing without a tracker."""
    if not trials:
        return
    sightings = [sighting for _, sighting in trials]
    ctx.metric("found", sum(sighting.found_s is not None for sighting in sightings), f"of {len(sightings)}")
    frames = sum(sighting.frames for sighting in sightings)
    ctx.metric("frames tracked", sum(sighting.tracked for sighting in sightings) / max(frames, 1), "fraction")
    judged = [(true, sighting.success) for true, sighting in trials if sighting.success is not None]
    if judged:
        ctx.metric("same verdict from measurements", sum(true == seen for true, seen in judged), f"of {len(judged)}")
        ctx.metric("false positives", sum(seen and not true for true, seen in judged), f"of {len(judged)}")
    for field_name, (what, unit, factor) in ERRORS.items():
        errors = factor * np.array([error for sighting in sightings for error in getattr(sighting, field_name)])
        if len(errors):
            ctx.metric(f"tracker, {what}, median", float(np.median(errors)), unit)
            ctx.metric(f"tracker, {what}, 95 %", float(np.quantile(errors, 0.95)), unit)


ERRORS = {
    "distances_m": ("position", "mm", 1000.0),
    "angles_rad": ("rotation", "deg", 180.0 / np.pi),
    "joints_rad": ("joint", "rad or m", 1.0),
}
"""Field of a sighting -> quantity, unit and factor of its error metrics."""


def digest_of(artifact: Artifact) -> str:
    """Digest of an artifact, the same as in the store."""
    return artifact.encode(digest.of_bytes)


def robot_name(bundle: TaskBundle) -> str:
    """The robot's name in its own MJCF."""
    try:
        root = ET.fromstring(bundle.robot.model.files.get("robot.xml", b"<mujoco/>"))
    except (ET.ParseError, LookupError, ValueError):
        root = ET.Element("mujoco")
    return root.get("model") or "robot"
