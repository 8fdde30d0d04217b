"""Begins what makes workers before it is known whether there is something for them to do.

To load what they need takes as long as all that comes before the first node, so both are done at once. That is worth
it where the same command was given before and something changed since: mostly a node has to run then. Else it has cost
the time of another core, and ends with the command; so there must be one that has nothing else to do.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from dextera_build.cli import quick

if TYPE_CHECKING:
    from dextera_build.engine.executors.nursery import Nursery

_NO = ("-h", "--help", "--check", "--executor")
"""Words of a command that needs no workers, or others."""


def begin(words: list[str]) -> Nursery | None:
    """What makes workers, in a fork of this process that loads what they need; None where that is not worth it.

    Args:
        words: The command line of this process, which has opened and begun nothing.
    """
    if words[:1] != ["build"] or any(word.startswith(_NO) for word in words) or "DXB_EXECUTOR" in os.environ:
        return None
    if not _has_free_core() or not quick.is_known(words):
        return None
    # What both need comes before the fork, and is loaded once.
    from dextera_build.build import executors
    from dextera_build.engine.executors.nursery import Nursery
    from dextera_build.engine.nursery import is_alone

    if not is_alone():
        return None
    try:
        made = Nursery(forked=True)
    except OSError:
        return None  # it is tried again where it is needed
    executors.load(made)
    return made


def _has_free_core() -> bool:
    """Whether this process can have a second core for itself, by what ran in the last minute."""
    cores = len(os.sched_getaffinity(0))
    try:
        return cores >= 2 and os.getloadavg()[0] < cores
    except OSError:
        return cores >= 2
