"""evaluate.operator_trials in MuJoCo."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import nullcontext
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.experts import planning
from dextera_build.sim.experts.deployed import Deployed
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import Acting
from dextera_build.sim.runtime.tracked_cell import TrackedCell

from .filmed import stills as stills
from .simulated_attempt import simulated

if TYPE_CHECKING:
    from .operator_trials import Case

BACKEND = Backend(
    summary="MuJoCo; inverse kinematics by mink; with a cell, the tracker of `align.track`",
    profiles=("cpu",),
    packages=("mujoco", "mink", "daqp", "open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)


def operated(ctx: Context, twin: TaskBundle, cases: list[Case], options: Options) -> Iterator[Attempt]:
    """One attempt per case, in order."""
    if not cases:
        return
    operator = _practised(ctx, twin)
    for _, group in itertools.groupby(cases, key=lambda case: (id(case.world), id(case.cell))):
        some = list(group)
        there, cell = Environment(some[0].world), some[0].cell
        with nullcontext() if cell is None else TrackedCell(there, cell, twin.objects, twin) as watching:
            for case in some:
                yield simulated(there, operator, case.seed, watching)


def _practised(ctx: Context, twin: TaskBundle) -> Acting:
    """The operator after its rehearsal in the twin; if no rehearsal succeeded, its trials give the reason."""
    driver = Driver(Environment(twin))
    return Deployed(driver, planning.practise(driver, ctx.progress, anyway=True))
