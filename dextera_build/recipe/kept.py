"""Plans of earlier commands, repeated if nothing that planning read has changed.

Planning imports every rule that a recipe calls, which takes ten times as long as to look up its nodes. A row of
`state.db` holds the plan of a request, with the signature of everything that planning read, as a snapshot does for a
whole build (`runs.snapshot`). A lost or foreign row costs one planning.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from typing import NamedTuple

from dextera_build import digest as digests
from dextera_build.code import modules
from dextera_build.engine.graph import Plan
from dextera_build.engine.plan_json import read, write
from dextera_build.errors import MachineError
from dextera_build.runs import snapshot
from dextera_build.store import seen
from dextera_build.store.signature import Watch
from dextera_build.store.state import State

_KIND = "plan"
_MOST = 32
"""Maximum number of plans in a store."""
_OF_SHELL = frozenset(("_", "OLDPWD", "SHLVL"))
"""Variables that shells change with every command; a rule may take the default of an option from any other one."""


class Kept(NamedTuple):
    """A plan, and the warnings of planning."""

    plan: Plan
    warnings: list[str]


class Plans:
    """The plans of one request that a store keeps.

    Args:
        state: The store's state.
        request: Everything that a plan depends on except files and the environment.
    """

    def __init__(self, state: State, request: object) -> None:
        self._state = state
        said = sorted((name, value) for name, value in os.environ.items() if name not in _OF_SHELL)
        text = repr((*snapshot.here(), said, request))
        self._name = digests.of_bytes(text.encode(errors="surrogatepass"))

    def find(self, watch: Watch | None = None, *, reads: bool = False) -> Kept | None:
        """The plan of the request if planning would give it again.

        Args:
            watch: Notes the files that planning read.
            reads: Read the sources, too, because workers may need their current text.
        """
        with suppress(ValueError, IndexError, TypeError, KeyError, AttributeError):  # none, or malformed
            rows = (self._state.get(_KIND, self._name) or b"").decode(errors="surrogateescape").split(seen.MARK)
            warnings, text = rows[seen.end(rows) :]
            if watch is not None:
                seen.note(rows, watch)
            if reads:
                _read_sources(rows)
            # Compared last, so that no change goes undetected; and so are the kinds of inputs.
            if not seen.still(rows):
                return None
            plan = read(text)
            if watch is not None:
                note_absent(plan, watch)
            if all(kind_of(path) == kind for path, kind in plan.kinds.items()):
                return Kept(plan, json.loads(warnings))
        return None

    def keep(self, kept: Kept, watch: Watch) -> None:
        """Keep a plan, unless the files that were read may have changed meanwhile.

        Args:
            kept: The plan, and the warnings of planning.
            watch: The files that planning read; its `started_ns` is before the first read.
        """
        rows = seen.texts(watch, time.time_ns())
        if watch.settled() and not any(seen.MARK in text for text in rows):
            rows += [json.dumps(kept.warnings), write(kept.plan)]
            row = seen.MARK.join(rows).encode(errors="surrogateescape")
            self._state.put_newest(_KIND, self._name, row, most=_MOST)


def is_lasting(plan: Plan) -> bool:
    """Whether a plan depends only on files and the environment, not on devices, images and missing requirements."""
    rules = plan.rules
    return not plan.absent and not any(
        rule.missing or rule.passed or rule.program or rule.gpus or rule.gpu_gb for rule in rules
    )


def note_absent(plan: Plan, watch: Watch) -> None:
    """Add the paths that inputs might name, and where nothing was."""
    for path, kind in plan.kinds.items():
        if not kind:
            watch.file(path)


def _read_sources(rows: list[str]) -> None:
    for path in seen.files(rows):
        if path.endswith(".py"):
            with suppress(MachineError):  # it is gone, which is noticed
                modules.read(path)


def kind_of(path: str) -> str:
    """`Folder`, `File`, or "" if nothing is at a path."""
    if os.path.isdir(path):
        return "Folder"
    return "File" if os.path.exists(path) else ""  # "" for an invalid path, for which `Path.exists` may raise
