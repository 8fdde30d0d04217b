"""Group trials into the cells of tables."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.rule import Context, Options
from dextera_build.statistics import Rate

JUDGED = ("primitive", "object", "goal", "limbs", "hold_s", "timeout_s", "control_hz")
"""Fields of a task that define success; the distribution of starts may differ between worlds."""


class SeriesOptions(Options):
    """Names of robots in tables."""

    robots: dict[str, str] = Field(default_factory=lambda: {"kuka_leap": "KL", "openarm_revo1": "OB"})
    """Name of a robot's model -> name in tables; the paper has KL and OB."""


TRACKED = ", tracked"
"""Suffix of the name of a world in which a tracker measured the objects."""


@dataclass(frozen=True, order=True)
class Pair:
    """A task and an embodiment: a row of the paper's tables."""

    robot: str
    """Name of the robot in tables."""
    task: str
    """Name of the task."""

    def __str__(self) -> str:
        return f"{self.robot}: {self.task}"


@dataclass(frozen=True)
class Cell:
    """All trials of one actor in one world of one pair."""

    pair: Pair
    """Task and embodiment."""
    label: str
    """Name of the actor in tables."""
    trials: Trials
    """The trials."""

    @property
    def world(self) -> str:
        """Kind of world, and whether objects were tracked there: `reference`, `reference, tracked`."""
        return self.trials.world + (TRACKED if self.trials.poses == "tracked" else "")

    @property
    def rate(self) -> Rate:
        """Success rate over all trials."""
        return Rate(self.trials.successes, len(self.trials.items), self.trials.stopped)

    @property
    def progress(self) -> Rate:
        """Mean fraction of the stages reached, over all trials."""
        return Rate(float(self.trials.progress.sum()), len(self.trials.items), self.trials.stopped)

    def shared(self, other: Cell) -> list[tuple[int, int]]:
        """Numbers of the trials here and in `other` that began with the same seed, in the order here."""
        there = {trial.seed: number for number, trial in enumerate(other.trials.items)}
        items = enumerate(self.trials.items)
        return [(number, there[trial.seed]) for number, trial in items if trial.seed in there]

    def against(self, other: Cell) -> tuple[list[bool], list[bool]]:
        """Verdicts here and in `other`, of `shared` trials."""
        shared = self.shared(other)
        return (
            [self.trials.items[here].success for here, _ in shared],
            [other.trials.items[there].success for _, there in shared],
        )


class Series:
    """Cells in the order of pair, actor (replays last) and world (the twin first); input labels are ignored.

    Args:
        ctx: Context for errors on rows that cannot share a table.
        trials: In any order.
        robots: Name of a robot's model -> name in tables.
    """

    def __init__(self, ctx: Context, trials: Collection[Trials], robots: dict[str, str]) -> None:
        ctx.check(bool(trials.items), "there are no trials", hint="give the outputs of `evaluate.rollouts`")
        self.cells: list[Cell] = []
        for part in trials.items.values():
            cell = Cell(Pair(robots.get(part.robot, part.robot), part.task.name), part.label, part)
            ctx.check(
                self.find(cell.pair, cell.label, cell.world) is None,
                f"two sets of trials are both `{cell.label}` in the {cell.world} world of `{cell.pair}`",
                hint="set `label` of `evaluate.rollouts`",
            )
            self.cells.append(cell)
        self.cells.sort(key=_order)
        for pair in self.pairs:
            _agree(ctx, [cell for cell in self.cells if cell.pair == pair])

    @property
    def pairs(self) -> list[Pair]:
        """All pairs, in order."""
        return sorted({cell.pair for cell in self.cells})

    @property
    def policies(self) -> list[str]:
        """Labels of all policies, in order, without replays."""
        return sorted({cell.label for cell in self.cells if cell.trials.actor == "policy"})

    def worlds(self, pair: Pair) -> list[str]:
        """Worlds other than the twin with trials of a pair, the reference world and exact poses first."""
        found = {cell.world for cell in self.cells if cell.pair == pair} - {"twin"}
        return sorted(found, key=lambda world: (not world.startswith("reference"), world))

    def find(self, pair: Pair, label: str, world: str) -> Cell | None:
        """Return a cell, or None."""
        wanted = (pair, label, world)
        return next((cell for cell in self.cells if (cell.pair, cell.label, cell.world) == wanted), None)

    def rate(self, pair: Pair, label: str, world: str) -> Rate | None:
        """Success rate of a cell, or None."""
        cell = self.find(pair, label, world)
        return cell.rate if cell else None


def _order(cell: Cell) -> tuple[Pair, bool, str, bool, str]:
    return cell.pair, cell.trials.actor == "replay", cell.label, cell.world != "twin", cell.world


def _agree(ctx: Context, cells: list[Cell]) -> None:
    """Check that each name refers to one robot and that success has one definition."""
    first = cells[0]
    for cell in cells[1:]:
        ctx.check(
            cell.trials.embodiment == first.trials.embodiment,
            f"robots with other joints or limits are both called `{first.pair.robot}`",
            hint="give each a name of its own in `robots`",
        )
        one, other = first.trials.task, cell.trials.task
        differs = [name for name in JUDGED if getattr(one, name) != getattr(other, name)]
        ctx.check(
            not differs,
            f"success in `{first.pair}` was not judged alike: `{'`, `'.join(differs)}`",
            hint="make all worlds of a task from one task bundle",
            **{name: f"{getattr(one, name)} and {getattr(other, name)}" for name in differs},
        )
