"""A local server that speaks as much of the Hugging Face hub's protocol as downloads need."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler

from tests import local_server

SHA = "0123456789abcdef0123456789abcdef01234567"


@dataclass
class Hub:
    """What the server holds, and what it was asked."""

    files: dict[str, bytes]
    token: str = ""
    """If set, it answers only to this token."""
    cut: int = 0
    """Break connections after this many bytes of a body; 0: never."""
    asked: list[str] = field(default_factory=list)
    address: str = ""


@contextmanager
def serving(hub: Hub) -> Iterator[Hub]:
    """Serve on a free port for the duration of the block."""
    with local_server.serving(type("Handler", (_Handler,), {"hub": hub})) as hub.address:
        yield hub


class _Handler(local_server.Quiet, BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    hub: Hub

    def do_HEAD(self) -> None:
        self._answer()

    def do_GET(self) -> None:
        self._answer()

    def _answer(self) -> None:
        hub, path = self.hub, self.path
        hub.asked.append(f"{self.command} {path}")
        name = path.rpartition(f"/{SHA}/")[2].removeprefix("/")
        if hub.token and self.headers.get("Authorization") != f"Bearer {hub.token}":
            self._give(401, b"{}", {"X-Error-Code": "GatedRepo", "X-Error-Message": "restricted"})
        elif path.startswith("/api/models/lab/tiny"):
            self._give(200, json.dumps(self._listing("/tree" in path)).encode(), {"Content-Type": "application/json"})
        elif name in hub.files:
            data = hub.files[name]
            etag = hashlib.sha256(data).hexdigest()
            self._give(200, data, {"ETag": f'"{etag}"', "X-Repo-Commit": SHA, "Accept-Ranges": "bytes"})
        else:
            self._give(404, b"{}", {"X-Error-Code": "RepoNotFound"})

    def _listing(self, tree: bool) -> object:
        if not tree:
            return {"id": "lab/tiny", "sha": SHA, "siblings": [{"rfilename": name} for name in self.hub.files]}
        return [
            {"type": "file", "path": name, "size": len(data), "oid": hashlib.sha1(data).hexdigest()}
            for name, data in self.hub.files.items()
        ]

    def _give(self, status: int, data: bytes, headers: dict[str, str]) -> None:
        first = int((self.headers.get("Range") or "bytes=0-").removeprefix("bytes=").partition("-")[0])
        if first and status == 200:
            status, headers = 206, headers | {"Content-Range": f"bytes {first}-{len(data) - 1}/{len(data)}"}
            data = data[first:]
        self.send_response(status)
        for name, value in (headers | {"Content-Length": str(len(data))}).items():
            self.send_header(name, value)
        self.end_headers()
        if self.command == "HEAD":
            return
        if self.hub.cut and len(data) > self.hub.cut:
            self.close_connection = True
            data = data[: self.hub.cut]
        self.wfile.write(data)
