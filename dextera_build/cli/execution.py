"""Runs a plan: executor, console, event log, history; prints what failed."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, TextIO

from dextera_build import __version__
from dextera_build.cli.consoles import console
from dextera_build.cli.errors import render_node, wants_colour
from dextera_build.cli.session import Session
from dextera_build.engine.events import Event, NodeFinished, fan_out
from dextera_build.engine.graph import Address

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult
    from dextera_build.recipe.plan import Plan

RUNNER = "dextera_build.runner:run_task"


class _Failures:
    """A listener that keeps what failed and what waits on it."""

    def __init__(self) -> None:
        self.failed: list[NodeFinished] = []
        self.waiting: dict[str, list[str]] = {}

    def __call__(self, event: Event) -> None:
        if isinstance(event, NodeFinished) and event.status == "failed":
            self.failed.append(event)
        if isinstance(event, NodeFinished) and event.status == "waits":
            for blocker in event.blocked_by:
                self.waiting.setdefault(blocker, []).append(event.node)

    def show(self, run: str, stream: TextIO) -> None:
        """One block per failed node."""
        for node in self.failed:
            waiting = self.waiting.get(node.node, [])
            print("\n" + render_node(node, waiting, run, colour=wants_colour(stream)), file=stream)


def execute(session: Session, plan: Plan, wanted: Sequence[Address], args: argparse.Namespace) -> RunResult:
    """Build `wanted` and return what became of every node."""
    from dextera_build.engine.eventlog import EventLog
    from dextera_build.engine.execute import RunInfo, build
    from dextera_build.engine.executors.local import LocalExecutor

    project, store = session.project, session.store
    kind = str(project.config["console"].value)
    failures = _Failures()
    force = frozenset(name.partition(":")[2] or name for name in args.force)
    with (
        EventLog(store) as log,
        LocalExecutor(RUNNER, project.jobs, environment={"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}) as workers,
        console("live" if kind == "auto" else kind, sys.stderr, verbose=args.verbose) as shown,
    ):
        result = build(
            plan.graph,
            wanted,
            store=store,
            executor=workers,
            listen=fan_out(log, shown, failures),
            info=RunInfo(log.run, str(project.root), project.profile, __version__, tuple(sys.argv[1:])),
            keep_going=args.keep_going,
            force=force,
        )
    if kind not in ("jsonl", "none"):
        failures.show(log.run, sys.stderr)
    return result
