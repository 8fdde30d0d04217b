"""Output of verbs that build, in addition to that of the console: placed files, notices and warnings."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dextera_build.building.build import Built
    from dextera_build.session import Session


def tell(built: Built, *, quiet: bool = False) -> None:
    """Print the notices of a build that its console did not show.

    Args:
        built: The build.
        quiet: The console is `none` or `jsonl`: changes of `dxb.lock` and stub backends are not reported.
    """
    from dextera_build.report.wording import count, some

    if built.lost:
        print(f"the disk is full: the log of run {built.run} lacks {count(built.lost, 'event')}", file=sys.stderr)
    for node, folder in built.placed.kept.items():
        kept = f"the edited ones are kept in {shown(folder)}"
        print(f"files of `{node}` in out/ were edited; they are restored, and {kept}", file=sys.stderr)
    if built.placed.removed:
        print(f"out of date and removed from out/: {some(built.placed.removed)}", file=sys.stderr)
    if built.notice and not quiet:
        print(built.notice, file=sys.stderr)
    if not quiet and (told := stubs_of(built)):
        print(told, file=sys.stderr)


def suggest(session: Session, built: Built) -> None:
    """Print the commands that show what a build made, unless nothing ran or the console is `none` or `jsonl`."""
    nodes = built.result.nodes.values()
    is_fresh = built.ok and any(node.status != "cached" for node in nodes)
    if session.project.console in ("none", "jsonl") or not is_fresh:
        return
    from dextera_build.cli.built import is_viewed
    from dextera_build.cli.consoles.lines import next_steps, plain
    from dextera_build.cli.errors import wants_colour
    from dextera_build.project import own

    node = "" if is_viewed(session, nodes) else next(reversed(built.placed.paths), "")
    twin = own.twin(session.project) if session.recipe.startswith("robot/") and not node else ""
    print(plain(next_steps(session.recipe, twin, node), colour=wants_colour(sys.stderr)), file=sys.stderr)


def stubs_of(built: Built) -> str:
    """How many results stub backends made; "" for none."""
    from dextera_build.report.wording import STUB, stubs

    made = [node.backend for node in built.result.nodes.values() if node.output]
    return stubs(made.count(STUB), len(made))


def warn() -> None:
    """Print the notices and warnings of all sessions, once."""
    from dextera_build.session import notices, warnings

    for text in notices:
        print(text, file=sys.stderr)
    notices.clear()
    for text in warnings:
        print(f"warning: {text}", file=sys.stderr)
    warnings.clear()


def lines(paths: Mapping[str, str]) -> str:
    """One line per target: its address, a tab, the path of its main file."""
    return "".join([f"{node}\t{shown(path)}\n" for node, path in paths.items()])


def shown(path: str) -> str:
    """A path as messages show it: relative if it is below the current folder."""
    return path.removeprefix(f"{os.getcwd()}/")
