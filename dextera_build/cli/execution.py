"""Runs a plan with a console."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dextera_build.build.build import Manner, carry_out
from dextera_build.cli.consoles import console
from dextera_build.engine.graph import Address
from dextera_build.session import Session

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult
    from dextera_build.recipe.plan import Plan


def execute(session: Session, plan: Plan, wanted: Sequence[Address], args: argparse.Namespace) -> RunResult:
    """Build `wanted` as the command line says, and return what became of every node."""
    kind = session.project.console
    force = frozenset(name.partition(":")[2] or name for name in args.force)
    with console("live" if kind == "auto" else kind, sys.stderr, verbose=args.verbose) as shown:
        done = carry_out(
            session,
            plan,
            wanted,
            shown,
            Manner(keep_going=args.keep_going, force=force, argv=tuple(sys.argv[1:]), whole=args.whole),
        )
    if done.lost:
        print(f"the disk is full: {done.lost} events of run {done.run} are not in its log", file=sys.stderr)
    return done.result
