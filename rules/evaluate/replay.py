"""evaluate.replay: replay rollouts that succeed in the twin in another world (paper, Table IV)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.trials import Attempt, Trials
from dextera_build.policy.contract import check_data
from dextera_build.policy.layout import embodiment
from dextera_build.rule import Context, Options, rule

from .attempts import resumed
from .protocol import TOLERANCE, Record, close, seeds
from .strip import moments, strip


class ReplayOptions(Options):
    """Options of evaluate.replay."""

    trials: int = Field(50, ge=1)
    """Number of successful rollouts in the twin to replay in the other world."""
    resets: int = Field(100, ge=1)
    """Maximum number of starts drawn for them."""
    seed: int = Field(0, ge=0)
    """Seed of the starts."""
    tries: int = Field(5, ge=1)
    """Maximum number of syntheses in the twin per start until one succeeds."""
    nearest: int = Field(5, ge=1)
    """Number of demonstrations with the most similar object pose from which one is drawn."""
    tracker_m: float = Field(0.0, ge=0)
    """Standard deviation of a simulated tracker's positions, per axis; added to the measured ones [m]."""
    tracker_deg: float = Field(0.0, ge=0)
    """Standard deviation of a simulated tracker's rotations, per axis; added to the measured ones [deg]."""
    lag_m: PositiveFloat = 0.02
    """Syntheses in which joint limits keep the palm farther than this from its command are discarded [m]."""
    press_n: NonNegativeFloat = 2.0
    """Syntheses with an unintended contact above this force are discarded [N]."""
    linger_s: float = Field(1.0, ge=0)
    """Time to hold the last joint targets after the trajectory [s]."""
    strip_frames: int = Field(6, ge=2)
    """Pictures in each film strip."""


class ReplayBackend(Protocol):
    """Interface of a backend of evaluate.replay."""

    def replays(
        self,
        ctx: Context,
        twin: TaskBundle,
        world: TaskBundle,
        sources: Episodes,
        cell: Cell | None,
        seeds: list[int],
        common: ReplayOptions,
        options: Any,
    ) -> Iterator[Attempt]:
        """One attempt per seed, in order, each independent of the earlier ones."""
        ...

    def stills(
        self, ctx: Context, bundle: TaskBundle, episode: Episode, rows: np.ndarray, view: View | None, options: Any
    ) -> np.ndarray | None:
        """Pictures (N, H, W, 3) uint8 of these steps; None for no pictures."""
        ...


@rule(
    version=2,
    packages=("numpy",),
    memory_gb=2.0,
    tolerance=TOLERANCE,
    runs={"twin": "primitive", "world": "primitive"},
)
def replay(
    ctx: Context[ReplayBackend],
    twin: TaskBundle,
    world: TaskBundle,
    sources: Episodes,
    view: View | None = None,
    cell: Cell | None = None,
    *,
    options: ReplayOptions,
) -> Trials:
    """Return the results of replaying the twin's successful rollouts in another world, joint targets [rad] open loop.

    At every reset of `world`, its tracked objects and joints are copied to the twin, `sources` are adapted to them by
    object-centric synthesis (Eq. 4) without action noise, and a rollout that succeeds in the twin is replayed in
    `world`. Resets without a success in the twin count as excluded, not as failures. With a `cell`, its tracker
    measures the world at the reset, and a reset whose object it does not find is a failure. Trials of an interrupted
    build are kept.
    """
    _agree(ctx, twin, world)
    check_data(twin, sources)
    ctx.check(bool(sources.items), "no demonstrations were given", hint="look at `dxb log` of the demonstrations")
    record = Record(world, "exact" if cell is None else "tracked")

    def make(left: list[int]) -> Iterator[Attempt]:
        made: Iterator[Attempt] = ctx.backend.replays(
            ctx, twin, world, sources, cell, left, options, ctx.backend_options
        )
        return made

    for attempt in resumed(ctx, seeds(options.seed, max(options.resets, options.trials)), make):
        record.add(attempt)
        ctx.progress(len(record.items), options.trials, f"{record.rate.successes} succeeded")
        if len(record.items) == options.trials:
            break
    close(ctx, record)
    for success in (True, False):
        if success in record.examples:
            number, attempt = record.examples[success]
            title = f"{world.task.name}, replay {number}"
            _show(ctx, (twin, world), attempt, view, options.strip_frames, title)
    return record.trials("replay", label="replay", source=sources)


def _agree(ctx: Context, twin: TaskBundle, world: TaskBundle) -> None:
    ctx.check(
        twin.kind == "twin",
        f"the input `twin` is a {twin.kind} world",
        hint="give the twin's task bundle as `twin`, the other world's as `world`",
    )
    sides = {
        "task": (twin.task.name, world.task.name),
        "robot": (embodiment(twin.robot)[:12], embodiment(world.robot)[:12]),
        "control rate": (f"{twin.task.control_hz:g} Hz", f"{world.task.control_hz:g} Hz"),
        "objects": (", ".join(sorted(twin.objects)), ", ".join(sorted(world.objects))),
        "joints": (_joints(twin), _joints(world)),
    }
    found = {
        what: f"{here} in the twin, {there} in the world" for what, (here, there) in sides.items() if here != there
    }
    ctx.check(
        not found,
        f"the two worlds do not hold the same task: {', '.join(found)}",
        hint="make the other world from the twin's task bundle",
        **found,
    )


def _joints(bundle: TaskBundle) -> str:
    return ", ".join(sorted(bundle.displacement_names)) or "none"


def _show(
    ctx: Context, worlds: tuple[TaskBundle, TaskBundle], attempt: Attempt, view: View | None, count: int, title: str
) -> None:
    """Show two film strips: the rollout in the twin above its replay, at the same times."""
    both = zip(worlds, (attempt.rehearsal, attempt.episode), strict=True)
    episodes = [(world, episode) for world, episode in both if episode is not None]
    rows = moments(max(len(episode.action) for _, episode in episodes), count)
    shown: dict[str, np.ndarray] = {
        world.kind: pictures
        for world, episode in episodes
        if (pictures := ctx.backend.stills(ctx, world, episode, rows, view, ctx.backend_options)) is not None
    }
    if shown:
        last = episodes[-1][1]
        verdict = "success" if last.success else f"failure: {last.reason}"
        ctx.preview(strip(shown, rows / worlds[0].task.control_hz), f"{title}, {verdict}")
