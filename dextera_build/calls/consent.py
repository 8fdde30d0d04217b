"""Consent to send data of a project to a service: who gave it, for which kind of data, where."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dextera_build.calls.question import Question
from dextera_build.errors import MachineError, UsageError
from dextera_build.store import files

VARIABLE = "DXB_CONSENT"
EVERY = "*"
"""In place of a kind of data or a project: all of them."""
CODE = "DXB-E365"


@dataclass(frozen=True, order=True)
class Consent:
    """One consent."""

    service: str
    data: str
    """Kind of data, or `*`."""
    project: str
    """Folder of the project, or `*`."""
    given: str = ""
    """Date."""

    @property
    def what(self) -> tuple[str, str, str]:
        """Service, kind of data and project."""
        return self.service, self.data, self.project


class Consents:
    """The consents of one user.

    Args:
        path: The file that records them, existing or not.
        project: Folder of the project.
    """

    def __init__(self, path: Path, project: str) -> None:
        self._path, self._project = path, project

    def all(self) -> list[Consent]:
        """Every recorded consent, also for other projects."""
        with suppress(OSError, ValueError, TypeError, KeyError):
            rows = json.loads(self._path.read_bytes())["consents"]
            return sorted(
                Consent(*(str(row[name]) for name in ("service", "data", "project", "given"))) for row in rows
            )
        return []

    def here(self) -> list[tuple[str, str]]:
        """(service, kind of data) pairs that may be sent from this project, also by the variable `DXB_CONSENT`.

        Raises:
            UsageError: The variable has another form than `SERVICE:KIND,...`.
        """
        recorded = [(one.service, one.data) for one in self.all() if one.project in (EVERY, self._project)]
        return [*recorded, *self.of_variable()]

    @staticmethod
    def of_variable() -> list[tuple[str, str]]:
        """(service, kind of data) pairs that the variable `DXB_CONSENT` allows; see `here`."""
        return list(_of_variable(os.environ.get(VARIABLE, "")))

    def give(self, service: str, kinds: Iterable[str], *, everywhere: bool = False) -> None:
        """Record consent for kinds of data of this project, or of all projects.

        Raises:
            StoreError: The file cannot be written.
        """
        project, today = EVERY if everywhere else self._project, time.strftime("%Y-%m-%d")
        new = [Consent(service, kind, project, today) for kind in kinds]
        known = {one.what for one in new}
        self._write([*(one for one in self.all() if one.what not in known), *new])

    def withdraw(self, service: str, kinds: Iterable[str]) -> int:
        """Forget consents for this project and for all; without kinds, all of the service. Returns their number.

        Raises:
            StoreError: The file cannot be written.
        """
        wanted = set(kinds)
        gone = [
            one
            for one in self.all()
            if one.service == service and one.project in (EVERY, self._project) and (not wanted or one.data in wanted)
        ]
        if gone:
            self._write([one for one in self.all() if one not in gone])
        return len(gone)

    def _write(self, rows: list[Consent]) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"consents": [vars(one) for one in sorted(rows)]}, indent=1)
        files.write(str(self._path), text.encode(), 0o600)


def refuse(asked: Question, given: Iterable[tuple[str, str]]) -> None:
    """Refuse to send data without the user's consent.

    Args:
        asked: The request.
        given: (service, kind of data), see `Consents.here`.

    Raises:
        MachineError: A kind of data in the request lacks consent.
    """
    allowed = set(given)
    for kind in asked.data:
        if not allowed & {(asked.service, kind), (asked.service, EVERY), (EVERY, EVERY)}:
            raise MachineError(
                f"`{asked.service}` would receive a {kind}, without your consent",
                code="DXB-E365",
                facts=asked.facts() | {"data": kind},
                hint=f"`dxb consent give {asked.service} {kind}`; in CI {VARIABLE}={asked.service}:{kind}",
            )


def _of_variable(text: str) -> Iterator[tuple[str, str]]:
    for part in filter(None, (part.strip() for part in text.split(","))):
        service, _, kind = part.partition(":")
        if part == "all":
            yield EVERY, EVERY
        elif service and kind:
            yield service, kind
        else:
            raise UsageError(
                f"`{part}` in `{VARIABLE}` is not a service with a kind of data",
                code="DXB-U181",
                facts={"form": "SERVICE:KIND,...", "example": "openai-chat:photograph"},
                hint=f"{VARIABLE}={part}:{EVERY}, or {VARIABLE}=all",
            )
