"""Runs a plan: workers, remotes, event log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dextera_build import __version__
from dextera_build.build.executors import executor
from dextera_build.engine.events import Listener, fan_out
from dextera_build.engine.graph import Address
from dextera_build.session import Session

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult
    from dextera_build.recipe.plan import Plan
    from dextera_build.store.remotes.exchange import Exchange


@dataclass(frozen=True)
class Manner:
    """How to build; see `engine.execute.build`."""

    keep_going: bool = False
    force: frozenset[str] = frozenset()
    argv: tuple[str, ...] = ()
    whole: bool = False
    bring_from: Exchange | None = None
    """Nothing runs: what the store lacks comes from these remotes, all of it, or is lacking."""


@dataclass(frozen=True)
class Done:
    """A run that ended."""

    run: str
    """Its id; "" where the store cannot be written."""
    result: RunResult
    lost: int
    """How many events had no room in its log."""


def exchange(session: Session) -> Exchange | None:
    """The remotes that the settings let a build use, or None where there are none."""
    used = session.project.used_remotes
    if not used or session.project.remotes.local == "r":
        return None
    from dextera_build.store.remotes.connect import guarded
    from dextera_build.store.remotes.exchange import Exchange

    return Exchange(session.store, [guarded(spec) for spec in used])


def carry_out(
    session: Session,
    plan: Plan,
    wanted: Sequence[Address],
    listen: Listener,
    manner: Manner,
) -> Done:
    """Build `wanted` with the executor of the settings and an event log; `listen` takes every event, too."""
    project, store = session.project, session.store
    # What is only brought runs nowhere.
    only = frozenset[str]() if manner.bring_from or project.remotes.local == "r" else None
    with executor(session, plan.rules, idle=manner.bring_from is not None) as workers:
        # Loaded while a worker loads what it needs.
        from dextera_build.engine.eventlog import EventLog
        from dextera_build.engine.execute import RunInfo, build

        with EventLog(store, gathers=True) as log:
            result = build(
                plan.graph,
                wanted,
                store=store,
                executor=workers,
                listen=fan_out(log, listen),
                info=RunInfo(log.run, str(project.root), project.profile, __version__, manner.argv),
                keep_going=manner.keep_going,
                force=manner.force,
                only=only,
                exchange=manner.bring_from or exchange(session),
                recall=project.asks_again and not manner.bring_from,
                whole=manner.whole or manner.bring_from is not None,
                pause=log.flush,
            )
    return Done(log.run, result, log.lost)
