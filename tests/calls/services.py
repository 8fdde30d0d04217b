"""A local chat endpoint with the faults of real ones."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler
from typing import Any

from tests import local_server

KEY = "sk-geheim-0123456789"


class Service:
    """Answers `POST /v1/chat/completions`; `faults` are served first, one per request."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []
        self.faults: list[str] = []
        self.content = "a red mug"
        self.contents: list[str] = []
        """Served first, one per request."""
        self.url = ""

    def answer(self) -> bytes:
        usage = {"prompt_tokens": 900, "completion_tokens": 100, "total_tokens": 1000, "cost": 0.002}
        content = self.contents.pop(0) if self.contents else self.content
        said = {"role": "assistant", "content": content}
        return json.dumps({"choices": [{"message": said}], "usage": usage}).encode()


@contextmanager
def serving() -> Iterator[Service]:
    service = Service()

    class Handler(local_server.Quiet, BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            service.asked.append({"path": self.path, "key": self.headers["Authorization"], **json.loads(body)})
            fault = service.faults.pop(0) if service.faults else ""
            self.misbehave(fault, service.answer())

        def misbehave(self, fault: str, body: bytes) -> None:
            if fault == "slow":
                time.sleep(1.5)
            if fault == "nonsense":
                body = b"<html>"
            status = int(fault) if fault.isdecimal() else 200
            if fault == "echo":
                body = json.dumps({"you sent": KEY}).encode()
            self.send_response(status)
            if status == 429:
                self.send_header("Retry-After", "1")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body[: len(body) // 2] if fault == "torn" else body)

    with local_server.serving(Handler) as address:
        service.url = f"{address}/v1"
        yield service
