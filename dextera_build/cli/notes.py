"""Writes what `quick` reads: a command line, its answer, and the state of all that the answer rests on.

A note says what snapshots say, and which project and settings led to them, in a form that is read without loading
anything.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from dextera_build import __version__
from dextera_build.cli import quick
from dextera_build.cli.shown import lines
from dextera_build.engine import snapshot
from dextera_build.errors import StoreError
from dextera_build.project import deciding_files
from dextera_build.store import files, presence, signature

if TYPE_CHECKING:
    from dextera_build.session import Session

_MOST = 64
"""So many notes are kept; each stands for one command line in one folder."""
Rows: TypeAlias = list[list[str]]


class Notes:
    """Collects the answers of one command; made before anything is read.

    Args:
        words: The command line without `dxb`.
    """

    def __init__(self, words: Sequence[str]) -> None:
        self._asked = quick.request(list(words), __version__)
        self._started_ns = time.time_ns()
        self._settings = {path: signature.look(path) for path in deciding_files()}
        self._found: list[tuple[Session, Path, dict[str, Any]]] = []

    def add(self, session: Session, path: Path, head: dict[str, Any] | None) -> None:
        """Note the answer for one recipe: the head of its snapshot, or None where none was written."""
        if head is not None:
            self._found.append((session, path, head))

    def write(self, recipes: int, *, told: bool) -> None:
        """Write the note, if there is an answer for each of so many recipes and all that it rests on is at rest.

        Args:
            recipes: How many were asked for.
            told: Whether the answer says on standard error that nothing ran.
        """
        if len(self._found) != recipes or not self._settled():
            return
        note: dict[str, Rows] = {name: [] for name in quick.SECTIONS}
        note |= {"request": [[self._asked]], "told": [["yes" if told else "no"]]}
        # A file that nobody may write to is no reason to fail, and neither is one that vanished just now.
        with suppress(OSError, ValueError, StoreError):
            _put(note, self._settings)
            if all(_add(note, *found) for found in self._found):
                _keep(self._asked, quick.spell(note))

    def _settled(self) -> bool:
        return all(
            signature.look(path) == known and not (known and signature.is_racy(known, self._started_ns))
            for path, known in self._settings.items()
        )


def _keep(asked: str, data: bytes) -> None:
    path = quick.place(asked)
    files.write(path, quick.sealed(data), 0o600)
    with os.scandir(os.path.dirname(path)) as entries:
        old = sorted((entry.stat().st_mtime_ns, entry.path) for entry in entries)
    for _, name in old[:-_MOST]:
        os.unlink(name)


def _add(note: dict[str, Rows], session: Session, path: Path, head: dict[str, Any]) -> bool:
    """Add what one snapshot says; False where a folder is too young for its time stamp to be trusted."""
    nodes, *placed = head["lines"]
    note["answers"].append([session.recipe, nodes, lines(dict(line.split("\t", 1) for line in placed))])
    if os.path.exists(session.last_path):
        note["contents"].append([session.last_path, session.variant])
    else:
        note["absent"].append([session.last_path])
    note["snapshots"].append([os.fspath(path)])
    note["contents"] += [[presence.BOOT, f"{head['boot']}\n"]] if head["boot"] else []
    _put(note, head["files"])
    _put(note, head["present"])
    folders, shards = _folders(note, head), _shards(path, head)
    if folders is None or shards is None:
        return False
    note["folders"] += folders
    note["shards"] += shards
    return True


def _put(note: dict[str, Rows], watched: Mapping[str, Sequence[int] | None]) -> None:
    note["files"] += [[path, "{} {} {} {}".format(*known)] for path, known in watched.items() if known]
    note["absent"] += [[path] for path, known in watched.items() if not known]


def _folders(note: dict[str, Rows], head: Mapping[str, Any]) -> Rows | None:
    found: Rows = []
    for kind, names in (("folders", signature.names), ("paths", signature.modules)):
        for path, known in head[kind].items():
            now, state = time.time_ns(), signature.look(path)
            if state is None or not os.path.isdir(path):
                _put(note, {path: state})
            else:
                found.append([path, f"{state[0]} {state[3]}"])
            # The stamp was taken first, so a name that comes now moves it, unless the clock has not.
            if names(path) != known or (state and signature.is_racy(state, now)):
                return None
    return found


def _shards(path: Path, head: dict[str, Any]) -> Rows | None:
    if any(not row[0] for row in head["shards"].values()) and not snapshot.is_present(path, head):
        return None
    shards = head["shards"]
    if not all(row[0] for row in shards.values()):
        return None
    return [[f"{head['store']}/{shard}", f"{row[0]} {row[1]}"] for shard, row in shards.items()]
