"""The log of a run: its events, one JSON line each, under `runs/<id>/events.jsonl`."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from dextera_build import digest as digests
from dextera_build.errors import UsageError, listing
from dextera_build.runs import events
from dextera_build.runs.events import Event, NodeProgress
from dextera_build.store import disk_full, failpoints, files, permissions
from dextera_build.store.store import Store

_FILE = "events.jsonl"
_PROGRESS_S = 1.0
_MOST = 256
"""Maximum number of buffered events."""
_TAIL = 1 << 14
"""Length above that of any final event [bytes]."""
_NOT_WRITABLE = {errno.EACCES, errno.EPERM, errno.EROFS, *disk_full.FULL}


class EventLog:
    """A listener that writes events to the log; use it as a context manager.

    Events are buffered: the sender calls `flush` before every wait. Only whole lines are written, so a killed build
    leaves at most one torn line, at the end. If the disk is full, events are dropped: the build's results matter more,
    and report a full disk themselves.

    Args:
        store: The store in which the run takes the next free id.

    Attributes:
        run: Id of the run, `0143`; "" if the store cannot be written, and nothing is logged.
        lost: Number of events dropped because the disk was full.
    """

    def __init__(self, store: Store) -> None:
        self.run = ""
        self.lost = 0
        self._lines: list[bytes] = []
        self._told: dict[str, float] = {}
        self._descriptor = -1
        self._size = 0
        folder = store.root / "runs"
        try:
            permissions.make_folder(str(folder))
            self.run = _allocate(folder)
            permissions.share_tree(str(folder / self.run))
            failpoints.reach("log.made")
            path = folder / self.run / _FILE
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            permissions.share_file(self._descriptor, str(folder), 0o644)
        except OSError as error:
            if error.errno in _NOT_WRITABLE:
                self.run = ""
                return
            raise files.store_error(error, str(folder)) from None

    def __call__(self, event: Event) -> None:
        """Buffer one event; at most one progress event per node and second is kept."""
        if self._descriptor < 0 or self._is_told(event):
            return
        self._lines.append(event.to_line().encode() + b"\n")
        if len(self._lines) >= _MOST:
            self.flush()

    def flush(self) -> None:
        """Write the buffered events."""
        lines, self._lines = self._lines, []
        if len(lines) > 1 and self._write(b"".join(lines)):
            return
        # If the batch does not fit on the disk, single lines may.
        self.lost += sum(not self._write(line) for line in lines)

    def _write(self, data: bytes) -> bool:
        try:
            failpoints.reach("log.event")
            files.write_all(self._descriptor, data)
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._size)  # a torn line would spoil the next one
            return False
        self._size += len(data)
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Flush and close the log."""
        if self._descriptor >= 0:
            self.flush()
            os.close(self._descriptor)
            self._descriptor = -1

    def _is_told(self, event: Event) -> bool:
        if not isinstance(event, NodeProgress) or event.done == event.total:
            return False
        told = event.time - self._told.get(event.node, -_PROGRESS_S) < _PROGRESS_S
        if not told:
            self._told[event.node] = event.time
        return told


def runs(store: Store) -> list[str]:
    """Ids of all runs, oldest first."""
    folder = store.root / "runs"
    names = [name for name in os.listdir(folder) if name.isdecimal()] if folder.is_dir() else []
    return sorted(names, key=int)


def read(store: Store, run: str) -> list[dict[str, Any]]:
    """The events of a run as plain data, without a torn last line.

    Raises:
        UsageError: There is no such run.
    """
    return list(lines(store, run))


def latest(
    store: Store, recipe: str | None = None, variant: str | None = None, *, workspace: str = "", ok: bool = False
) -> str | None:
    """Id of the last run in `those`, with `ok` of the successful ones; None if there is none."""
    return next(those(store, recipe, variant, workspace=workspace, ok=ok), None)


def those(
    store: Store, recipe: str | None = None, variant: str | None = None, *, workspace: str = "", ok: bool = False
) -> Iterator[str]:
    """Ids of runs, newest first.

    Args:
        store: The store.
        recipe: Their recipe; None: any.
        variant: The variant of their request; None: any.
        workspace: The `mark` of their workspace; runs without one count, too.
        ok: Leave out those that did not succeed.
    """
    for run in reversed(runs(store)):
        first = next(lines(store, run), None)
        if first is None or (recipe is not None and first.get("recipe") != recipe):
            continue
        of_request = first.get("workspace", "") in ("", workspace) and variant in (None, first.get("variant", ""))
        if of_request and (not ok or _succeeded(store, run)):
            yield run


def _succeeded(store: Store, run: str) -> bool:
    """Whether the last line of a run's log, its final event, says so."""
    with suppress(OSError, ValueError), (store.root / "runs" / run / _FILE).open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - _TAIL))
        last = digests.plain(file.read().rstrip(b"\n").rpartition(b"\n")[2])
        return events.is_event(last) and last["event"] == "run_finished" and bool(last["ok"])
    return False


def lines(store: Store, run: str) -> Iterator[dict[str, Any]]:
    """Yield the events of a run lazily, as plain data.

    Raises:
        UsageError: There is no such run.
    """
    path = store.root / "runs" / run / _FILE
    try:
        with path.open("rb") as file:
            for line in file:
                if line.endswith(b"\n"):
                    with suppress(ValueError):  # a power cut may leave a hole in the middle
                        event = digests.plain(line)
                        if events.is_event(event):
                            yield event
    except (FileNotFoundError, NotADirectoryError):
        if not path.parent.is_dir() or not run:
            raise UsageError(
                f"there is no run `{run}`",
                code="DXB-U204",
                facts={"runs": listing(runs(store)[-12:])},
                hint="dxb ls runs",
            ) from None


def _allocate(folder: Path) -> str:
    known = [int(name) for name in os.listdir(folder) if name.isdecimal()]
    number = max(known, default=0) + 1
    while True:
        try:
            (folder / f"{number:04d}").mkdir()
        except FileExistsError:
            number += 1
        else:
            return f"{number:04d}"
