"""Random moments of a build: whatever Python itself can tell of, from the first file that is opened to the last."""

from __future__ import annotations

import json
import os
import random
import signal
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tests.oracle.projects import RandomProject

_TOLD = {"open", "exec", "compile", "import", "os.listdir", "os.scandir", "os.mkdir", "os.rename", "os.remove"}
_TOLD |= {"os.utime", "os.chmod", "os.link", "subprocess.Popen", "sqlite3.connect", "time.sleep", "socket.__new__"}
_MOST = 11
"""Logarithm of the number of the last moment at which something may happen."""


def any_moment(chance: random.Random) -> int:
    """The number of a moment; early ones, at which plans are made, are as likely as late ones."""
    return int(2 ** chance.uniform(0, _MOST))


def at_moments(actions: Mapping[int, Callable[[], object]]) -> None:
    """From now on call each action when this process comes to the moment of its number; a child calls this."""
    count, busy = 0, False

    def hear(event: str, _: tuple[Any, ...]) -> None:
        nonlocal count, busy
        if busy or event not in _TOLD:
            return
        count += 1
        if count in actions:
            busy = True
            actions[count]()
            busy = False

    sys.addaudithook(hear)


def die() -> None:
    """End this process at once."""
    os.kill(os.getpid(), signal.SIGKILL)


class Past:
    """Every state that a project had while it was built.

    Args:
        project: Its first state counts.
        notes: A file that children write.
    """

    def __init__(self, project: RandomProject, notes: Path) -> None:
        self._project = project
        self._notes = notes
        self._edits = project.edits[:]
        self.states = [project.files()]

    def edit(self) -> None:
        """Change one thing; also in a child of this process."""
        edit = self._project.edit()
        with self._notes.open("a") as notes:
            print(json.dumps([edit, self._project.files()]), file=notes)

    def learn(self) -> list[dict[str, str]]:
        """Take over what was noted; returns the last state that was known, and those that came since."""
        lines = self._notes.read_text().splitlines() if self._notes.exists() else []
        self._notes.unlink(missing_ok=True)
        noted = [json.loads(line) for line in lines]
        self._edits += [edit for edit, _ in noted]
        self._project.edits = self._edits[:]
        self.states += [files for _, files in noted]
        assert self._project.files() == self.states[-1]
        return self.states[-len(noted) - 1 :]
