"""A local service that works on jobs, with the faults of real ones, and its client."""

from __future__ import annotations

import json
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler

from dextera_build.calls import JobState, Response
from tests import local_server


class JobService:
    """`POST /jobs`, `GET /jobs/NAME`, `GET /jobs/NAME/answer`, `DELETE /jobs/NAME`; a job takes `polls` polls.

    Faults by method and kind of path (`POST`, `GET`, `FETCH`, `DELETE`) are served first, one per request: a status,
    `torn` (half of the body), `cut` (no answer), `slow`, `nonsense`.
    """

    def __init__(self) -> None:
        self.url = ""
        self.polls = 2
        self.fails = ""
        self.faults: dict[str, list[str]] = {}
        self.jobs: dict[str, int] = {}
        self.cancelled: list[str] = []
        self.seen: list[str] = []
        self.holds = threading.Event()
        """Set: `POST` answers. Cleared: it waits, with the job made."""
        self.holds.set()

    def answer(self, kind: str, name: str) -> tuple[int, object]:
        if kind == "POST":
            name = f"job-{len(self.jobs) + 1}"
            self.jobs[name] = self.polls
            self.holds.wait(20)
            return 200, {"id": name}
        if name not in self.jobs:
            return 404, {}
        if kind == "DELETE":
            self.cancelled.append(name)
            return 200, {}
        if kind == "FETCH":
            return 200, {"text": f"made by {name}"}
        self.jobs[name] -= 1
        if self.jobs[name] >= 0:
            return 200, {"state": "runs"}
        return 200, {"state": "failed" if self.fails else "done", "said": self.fails}


@contextmanager
def serving_jobs() -> Iterator[JobService]:
    service = JobService()

    class Handler(local_server.Quiet, BaseHTTPRequestHandler):
        def answer(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"] or 0))
            parts = self.path.strip("/").split("/")
            kind = "FETCH" if parts[-1] == "answer" else self.command
            service.seen.append(kind)
            fault = (service.faults.get(kind) or [""]).pop(0)
            if fault == "cut":
                self.close_connection = True
                self.connection.close()
                return
            if fault == "slow":
                time.sleep(1.5)
            status, said = (int(fault), {}) if fault.isdecimal() else service.answer(kind, "".join(parts[1:2]))
            body = b"<html>" if fault == "nonsense" else json.dumps(said).encode()
            self.send_response(status)
            if status == 429:
                self.send_header("Retry-After", "1")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body[: len(body) // 2] if fault == "torn" else body)

        def do_POST(self) -> None:
            self.answer()

        def do_GET(self) -> None:
            self.answer()

        def do_DELETE(self) -> None:
            self.answer()

    with local_server.serving(Handler) as address:
        service.url = address
        yield service


class Client:
    """A `Job` that uses nothing but the standard library."""

    def __init__(self, url: str, patience_s: float | None = None) -> None:
        self._url, self._patience_s = url, patience_s

    def submit(self, timeout_s: float) -> str | Response:
        found = self._send("POST", "", timeout_s, b"{}")
        return found if isinstance(found, Response) else str(json.loads(found)["id"])

    def poll(self, name: str, timeout_s: float) -> JobState | Response:
        found = self._send("GET", f"/{name}", timeout_s)
        if isinstance(found, Response):
            return found
        told = json.loads(found)
        return JobState(told["state"], told.get("said", ""))

    def fetch(self, name: str, timeout_s: float) -> bytes | Response:
        return self._send("GET", f"/{name}/answer", timeout_s)

    def cancel(self, name: str, timeout_s: float) -> bool:
        return isinstance(self._send("DELETE", f"/{name}", timeout_s), bytes)

    def _send(self, method: str, path: str, timeout_s: float, data: bytes | None = None) -> bytes | Response:
        asked = urllib.request.Request(f"{self._url}/jobs{path}", method=method, data=data)
        try:
            with urllib.request.urlopen(asked, timeout=self._patience_s or timeout_s) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            return Response(error.read(), error.code, dict(error.headers))
