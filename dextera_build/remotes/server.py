"""The store over HTTP: GET, HEAD and PUT of `/ac/<hex>` and `/cas/<hex>`.

A result that is not whole is not served, and one that is whole is never replaced.
"""

from __future__ import annotations

import base64
import hmac
import os
import re
import socket
import ssl
from collections.abc import Iterator
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TextIO

from dextera_build.errors import StoreError
from dextera_build.remotes.remote import MOST_ENTRY
from dextera_build.store import entry as entries
from dextera_build.store import traces
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store

_PATH = re.compile(r"/(ac|cas)/([0-9a-f]{64})")
_CHUNK = 1 << 18
_IDLE_S = 60.0


class CacheServer(ThreadingHTTPServer):
    """Serves one store, a thread for each connection; use it as a context manager.

    Args:
        store: What to serve.
        address: Host and port to listen at; port 0 is any that is free.
        read_only: Take nothing.
        most_bytes: Largest blob that is taken [bytes].
        log: Gets a line for each request; None for none.
        secret: Password of the user `dxb`, whom alone it serves; "" serves everyone.
        tls: PEM file with a certificate and its private key; "" serves plain HTTP.

    Raises:
        OSError: Nothing can listen there, or the certificate cannot be used.
    """

    daemon_threads = True
    request_queue_size = 128

    def __init__(
        self,
        store: Store,
        address: tuple[str, int],
        *,
        read_only: bool = False,
        most_bytes: int = 16_000_000_000,
        log: TextIO | None = None,
        secret: str = "",
        tls: str = "",
    ) -> None:
        if ":" in address[0]:
            self.address_family = socket.AF_INET6
        self.store, self.read_only, self.most_bytes, self.log = store, read_only, most_bytes, log
        self.welcome = b"Basic " + base64.b64encode(f"dxb:{secret}".encode()) if secret else b""
        """What a client must say to be served."""
        self.given = self.taken = 0
        self._scheme = "https" if tls else "http"
        super().__init__(address, partial(_Request))
        if tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(tls)
            # The handshake comes with the first read, in the thread of the connection: a client may take its time.
            self.socket = context.wrap_socket(self.socket, server_side=True, do_handshake_on_connect=False)

    @property
    def url(self) -> str:
        """Where clients find it."""
        host, port = self.server_address[:2]
        shown = str(host)
        return f"{self._scheme}://[{shown}]:{port}" if ":" in shown else f"{self._scheme}://{shown}:{port}"

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignored: clients may disconnect at any time."""


class _Request(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version = "dxb"
    sys_version = ""
    timeout = _IDLE_S
    disable_nagle_algorithm = True
    server: CacheServer

    def do_GET(self) -> None:
        """Give a blob or a result."""
        self._give(body=True)

    def do_HEAD(self) -> None:
        """Say whether it is there, and its size."""
        self._give(body=False)

    def do_PUT(self) -> None:
        """Take a blob, or a result whose blobs are there."""
        place, length = self._place(), self._length()
        if place is None or length is None:
            return
        most = MOST_ENTRY if place[0] == "ac" else self.server.most_bytes
        if self.server.read_only:
            self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, "this cache is read-only")
        elif length > most:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"more than {most:,} bytes are not taken")
        else:
            self._take(*place, length)

    def log_message(self, format: str, *words: object) -> None:
        """Only where a log is wanted."""
        if self.server.log is not None:
            said = (format % words).encode("ascii", "backslashreplace").decode()
            print(f"{self.address_string()} {said}", file=self.server.log, flush=True)

    def _give(self, *, body: bool) -> None:
        place = self._place()
        if place is None:
            return
        kind, digest = place
        if kind == "ac":
            actions = self.server.store.actions
            entry = actions.entry(digest) if actions.get(digest) is not None else None
            if entry is None:
                self._answer(HTTPStatus.NOT_FOUND)
            else:
                self._answer(HTTPStatus.OK, entry.spell(), body=body)
            return
        try:
            file = self.server.store.blobs.open(digest)
        except MissingBlob:
            self._answer(HTTPStatus.NOT_FOUND)
            return
        with file:
            self._head(HTTPStatus.OK, file.seek(0, os.SEEK_END))
            file.seek(0)
            if body:
                self.wfile.flush()
                self.connection.sendfile(file)
        self.server.given += 1

    def _take(self, kind: str, digest: str, length: int) -> None:
        pieces = self._pieces(length)
        try:
            if kind == "ac":
                problem = _publish(self.server.store, digest, b"".join(pieces))
            else:
                problem = self._take_blob(digest, length, pieces)
            for _ in pieces:  # the next request begins where this one's body ends
                pass
        except StoreError as error:
            self._refuse(HTTPStatus.INSUFFICIENT_STORAGE, error.message)
            return
        except EOFError:
            self.close_connection = True
            return
        if problem:
            self._refuse(HTTPStatus.BAD_REQUEST, problem)
        else:
            self.server.taken += 1
            self._answer(HTTPStatus.OK)

    def _take_blob(self, digest: str, length: int, pieces: Iterator[bytes]) -> str:
        blobs = self.server.store.blobs
        if blobs.size(digest) == length:
            blobs.verify(digest)  # a damaged one is set aside, and replaced by what comes
        return "" if blobs.receive(digest, length, pieces) else "these bytes have another digest"

    def _pieces(self, length: int) -> Iterator[bytes]:
        while length > 0:
            piece = self.rfile.read(min(length, _CHUNK))
            if not piece:
                raise EOFError
            length -= len(piece)
            yield piece

    def _place(self) -> tuple[str, str] | None:
        welcome = self.server.welcome
        if welcome and not hmac.compare_digest(self.headers.get("Authorization", "").encode(), welcome):
            self._refuse(HTTPStatus.UNAUTHORIZED, "a name and a password are needed")
            return None
        match = _PATH.fullmatch(self.path)
        if match is None:
            self._refuse(HTTPStatus.NOT_FOUND, "only /ac/<sha256> and /cas/<sha256> are here")
            return None
        return match[1], match[2]

    def _length(self) -> int | None:
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()) or "Transfer-Encoding" in self.headers:
            self._refuse(HTTPStatus.LENGTH_REQUIRED, "Content-Length is needed")
            return None
        return int(length)

    def _refuse(self, status: HTTPStatus, reason: str) -> None:
        self.close_connection = True  # the body may not have been read
        self._answer(status, f"{reason}\n".encode())

    def _answer(self, status: HTTPStatus, data: bytes = b"", *, body: bool = True) -> None:
        self._head(status, len(data))
        if body and self.command != "HEAD":
            self.wfile.write(data)
        if status == HTTPStatus.OK and data:
            self.server.given += 1

    def _head(self, status: HTTPStatus, length: int) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(length))
        self.send_header("Content-Type", "application/octet-stream")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()


def _publish(store: Store, key: str, message: bytes) -> str:
    """Take a result; returns why not, or "".

    Raises:
        StoreError: The disk is full, or the store cannot be written.
    """
    try:
        entry = entries.read(message)
    except ValueError:
        return "this is no result of dxb"
    if entry.key != key or entry.is_bare:
        return "the result of another key, or a bare one"
    lacking = next((file for file in entry.files if store.blobs.size(file.digest) != file.size), None)
    if lacking is not None:
        return f"blob {lacking.digest} is not here; blobs come first"
    try:
        if store.actions.get(key) is None or traces.listed(store, entry.result):
            traces.publish(store, key, entry.result)
    except MissingBlob as error:
        return f"blob {error.digest} is not here; blobs come first"
    except StoreError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return "a header is damaged"
    return ""
