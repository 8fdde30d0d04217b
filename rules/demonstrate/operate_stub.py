"""demonstrate.operate without a simulator: nothing moves, and every episode succeeds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import layout
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

if TYPE_CHECKING:
    from .operate import OperateOptions

BACKEND = Backend(summary="no simulation: nothing moves, and every episode succeeds", profiles=("stub",))


def operate(
    ctx: Context,
    bundle: TaskBundle,
    terms: tuple[TermSpec, ...],
    recording: HandStream | None,
    common: OperateOptions,
    options: Options,
) -> Episodes:
    """Return the requested number of motionless episodes, or one per take."""
    count = min(common.most()) if recording is None else len(recording.demonstrations[: common.attempts])
    items = {
        f"{number:05d}": fake_trial(bundle, common.seed + number, "operator", success=True, terms=terms)
        for number in range(count)
    }
    return layout.gathered(bundle, items, {}, len(items), terms)


def strips(ctx: Context, bundle: TaskBundle, episodes: Episodes, options: Options) -> list[tuple[str, np.ndarray]]:
    """No pictures."""
    return []
