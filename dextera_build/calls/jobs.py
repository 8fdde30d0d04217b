"""Runs a job of a service: submitted once, even if the build is killed; polled and fetched; cancelled by Ctrl-C."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from dextera_build.calls import Job, JobState, Response
from dextera_build.calls.asking import Manner, checked, step
from dextera_build.calls.gate import Emit
from dextera_build.calls.question import Question
from dextera_build.calls.secrets import without_secrets
from dextera_build.errors import DxbError, MachineError, RuleError
from dextera_build.store import files

GRACE_S = 10.0
"""Time that a worker with a job gets after Ctrl-C, to cancel it [s]."""
_CANCEL_S = 8.0
_SHORT_GRACE_S = 1.0
_FILE = "job.json"
_UNKNOWN = 404
_SHOWN = 300


class Run:
    """The job of one request.

    Args:
        asked: The request.
        job: The service's client.
        manner: Timeouts, retries and checks.
        folder: Keeps the name of the job until the answer is recorded.
        emit: Takes `log`, `progress` and `grace` messages.
    """

    def __init__(self, asked: Question, job: Job, manner: Manner, folder: Path, emit: Emit) -> None:
        self._asked, self._job, self._manner = asked, job, manner
        self._file, self._emit = folder / _FILE, emit
        self._name = ""

    def answer(self) -> tuple[Response, float]:
        """The answer of the job, and the time that this process waited for it [s].

        Raises:
            MachineError: The service cannot be reached, or the job takes too long; the next build waits for it again.
            RuleError: The job failed, or its answer is unusable; the next build submits a new one.
        """
        began = time.monotonic()
        self._emit("grace", {"seconds": GRACE_S})
        try:
            body = self._followed(began)
        except (KeyboardInterrupt, SystemExit):
            self._cancel()
            raise
        finally:
            self._emit("grace", {"seconds": _SHORT_GRACE_S})
        return Response(body), time.monotonic() - began

    def _followed(self, began: float) -> bytes:
        self._name = self._kept()
        if self._name:
            self._say(f"waits for the job {self._name} of an earlier build")
            if not self._wait(began):
                self._say(f"does not know the job {self._name} any more")
                self._forget()
        if not self._name:
            self._submit()
            if not self._wait(began):
                raise self._failed("the service does not know it")
        try:
            return step(self._asked, self._fetch, self._manner, self._say)
        except RuleError:
            self._forget()
            raise

    def _submit(self) -> None:
        def once(timeout_s: float) -> str | Response:
            with _undisturbed():
                name = self._job.submit(timeout_s)
                if isinstance(name, str) and name:
                    self._name = name
                    files.write(str(self._file), json.dumps({"job": name}).encode(), 0o644)
            return name

        name = step(self._asked, once, self._manner, self._say)
        if not name:
            raise self._failed("the service gives it no name")
        self._say(f"submitted the job {name}")

    def _wait(self, began: float) -> bool:
        """Poll until the job is done; return False if the service does not know it."""
        last = JobState("waits")
        while True:
            told = self._told()
            if told is None or told.state == "done":
                return told is not None
            if told.state == "failed":
                self._forget()
                raise self._failed(told.said)
            if told.state != last.state or told.done != last.done:
                what = f"{self._asked.service} job {told.state}"
                self._emit("progress", {"done": round(100 * told.done), "total": 100, "what": what})
                last = told
            if time.monotonic() - began + self._manner.poll_s > self._manner.limit_s:
                raise self._late(told)
            time.sleep(self._manner.poll_s)

    def _told(self) -> JobState | None:
        try:
            return step(self._asked, self._poll, self._manner, self._say)
        except RuleError:  # the service refuses to report the state, and would in every further build
            self._forget()
            raise

    def _poll(self, timeout_s: float) -> JobState | Response | None:
        told = self._job.poll(self._name, timeout_s)
        return None if isinstance(told, Response) and told.status == _UNKNOWN else told

    def _fetch(self, timeout_s: float) -> bytes | Response:
        return checked(self._asked, self._job.fetch(self._name, timeout_s), self._manner)

    def _cancel(self) -> None:
        """Cancel the job, once and quickly; if that fails, the next build waits for the job."""
        if not self._name:
            return
        try:
            cancelled = self._job.cancel(self._name, _CANCEL_S)
        except Exception as error:
            why = without_secrets(f"{type(error).__name__}: {error}", self._manner.secrets)
            self._say(f"the job {self._name} could not be cancelled: {why}")
            return
        self._say(f"cancelled the job {self._name}" if cancelled else f"cannot cancel the job {self._name}")
        if cancelled:
            self._forget()

    def _kept(self) -> str:
        with suppress(OSError, ValueError, KeyError, TypeError):
            name = json.loads(self._file.read_bytes())["job"]
            return name if isinstance(name, str) else ""
        return ""

    def _forget(self) -> None:
        self._name = ""
        self._file.unlink(missing_ok=True)

    def _failed(self, why: str) -> DxbError:
        said = " ".join(without_secrets(why, self._manner.secrets).split())[:_SHOWN]
        return RuleError(
            f"the job of `{self._asked.shown}` failed: {said or 'no reason is given'}",
            code="DXB-B360",
            facts=self._asked.facts() | ({"job": self._name} if self._name else {}),
            hint="nothing was recorded; the next build submits a new job",
        )

    def _late(self, told: JobState) -> DxbError:
        return MachineError(
            f"the job of `{self._asked.shown}` is not done after {self._manner.limit_s:.0f} s",
            code="DXB-E364",
            facts=self._asked.facts() | {"job": self._name, "state": told.state},
            hint="build again: it waits for the same job",
        )

    def _say(self, text: str) -> None:
        named = text if text.startswith(self._asked.shown) else f"{self._asked.shown}: {text}"
        self._emit("log", {"text": named})


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Hear Ctrl-C and the request to end only after the block, when the name of a submitted job is known."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard: list[tuple[int, FrameType | None]] = []
    before = {int(number): signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in before:
        signal.signal(number, lambda number, frame: heard.append((number, frame)))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for number, _ in heard[:1]:
            signal.raise_signal(number)
