"""Runs a plan: workers, console, event log."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dextera_build import __version__
from dextera_build.cli.consoles import console
from dextera_build.cli.session import Session
from dextera_build.engine.events import fan_out
from dextera_build.engine.graph import Address

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult
    from dextera_build.engine.known import Known
    from dextera_build.recipe.plan import Plan

RUNNER = "dextera_build.runner:run_task"


def execute(
    session: Session, plan: Plan, wanted: Sequence[Address], args: argparse.Namespace, known: Known | None = None
) -> RunResult:
    """Build `wanted` and return what became of every node."""
    from dextera_build.engine.eventlog import EventLog
    from dextera_build.engine.execute import RunInfo, build
    from dextera_build.engine.executors.local import LocalExecutor

    project, store = session.project, session.store
    kind = str(project.config["console"].value)
    # One thread per worker: sums do not depend on the machine's cores, and workers do not fight for them.
    environment = {"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl"), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    force = frozenset(name.partition(":")[2] or name for name in args.force)
    with (
        EventLog(store) as log,
        LocalExecutor(RUNNER, project.jobs, environment=environment) as workers,
        console("live" if kind == "auto" else kind, sys.stderr, verbose=args.verbose) as shown,
    ):
        result = build(
            plan.graph,
            wanted,
            store=store,
            executor=workers,
            listen=fan_out(log, shown),
            info=RunInfo(log.run, str(project.root), project.profile, __version__, tuple(sys.argv[1:])),
            keep_going=args.keep_going,
            force=force,
            known=known,
        )
    if log.lost:
        print(f"the disk is full: {log.lost} events of run {log.run} are not in its log", file=sys.stderr)
    return result
