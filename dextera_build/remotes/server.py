"""Serves the store over HTTP: GET, HEAD and PUT of `/ac/<hex>` and `/cas/<hex>`.

Only whole results are served, and they are never replaced. Requests of web pages are refused: those that name their
origin, and those to a name that is not this machine's.
"""

from __future__ import annotations

import base64
import hmac
import math
import os
import re
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from tempfile import SpooledTemporaryFile
from typing import Any, TextIO

from dextera_build.errors import StoreError
from dextera_build.remotes.remote import MOST_ENTRY, is_loopback, is_named
from dextera_build.store import entry as entries
from dextera_build.store import files, traces
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.references import UNREADABLE
from dextera_build.store.store import Store

_PATH = re.compile(r"/(ac|cas)/([0-9a-f]{64})")
_CHUNK = 1 << 18
_IDLE_S = 60.0
"""How long a client may take for the head of a request, for a chunk of its body, and at least for an answer [s]."""
_SLOWEST = 4096
"""Bytes that a client must take in a second."""
_MOST_CONNECTIONS = 512
_LARGE_ENTRY = 1 << 20
"""Longer entries are written to disk, and read one at a time [bytes]."""


class CacheServer(ThreadingHTTPServer):
    """Serves one store, a thread for each connection; use it as a context manager.

    Args:
        store: The store to serve.
        address: Host and port to listen on; port 0: any free port.
        read_only: Accept no uploads.
        most_bytes: Largest blob that is accepted [bytes].
        log: Gets a line for each request; None: no log.
        secret: Password that clients must send as user `dxb`; "" serves everyone.
        tls: PEM file with a certificate and its private key; "" serves plain HTTP.

    Raises:
        OSError: The address is not available, or the certificate cannot be used.
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
        """`Authorization` header that a client must send."""
        own = {"localhost", address[0].lower(), socket.gethostname().lower()}
        self.names = own if is_loopback(address[0]) and not secret else None
        """The names by which clients may call this server; None: any, because no page knows the secret."""
        self.reading = threading.Lock()
        """Held while a large entry is in memory."""
        self._until: dict[socket.socket, float] = {}
        """Open connection -> when it is closed, by `time.monotonic`."""
        self._scheme = "https" if tls else "http"
        super().__init__(address, partial(_Request))
        if tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(tls)
            # The handshake comes with the first read, in the connection's thread: a slow client delays no other.
            self.socket = context.wrap_socket(self.socket, server_side=True, do_handshake_on_connect=False)

    @property
    def url(self) -> str:
        """Address for clients."""
        host, port = self.server_address[:2]
        shown = str(host)
        return f"{self._scheme}://[{shown}]:{port}" if ":" in shown else f"{self._scheme}://{shown}:{port}"

    def allow(self, connection: socket.socket, seconds: float) -> None:
        """Close a connection unless `allow` is called again within a number of seconds."""
        self._until[connection] = time.monotonic() + seconds

    def service_actions(self) -> None:
        """Close the connections whose time is over: a client that sends a byte now and then holds a thread."""
        now = time.monotonic()
        for connection in [connection for connection, until in list(self._until.items()) if until < now]:
            with suppress(OSError):
                socket.socket.shutdown(connection, socket.SHUT_RDWR)  # of the socket below TLS, too

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread for a connection; at most `_MOST_CONNECTIONS` are open."""
        if len(self._until) >= _MOST_CONNECTIONS:
            self.shutdown_request(request)
            return
        self.allow(request, _IDLE_S)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection."""
        self._until.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignored: clients may disconnect at any time."""


class _RefusedError(Exception):
    """A request is refused; the connection ends, since its body may not have been read."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class _Request(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version = "dxb"
    sys_version = ""
    timeout = _IDLE_S
    disable_nagle_algorithm = True
    server: CacheServer

    def handle_one_request(self) -> None:
        """Handle the next request of a connection."""
        self.server.allow(self.connection, _IDLE_S)
        super().handle_one_request()

    def do_GET(self) -> None:
        """Serve a blob or a result."""
        self._carry_out(self._give)

    def do_HEAD(self) -> None:
        """Answer whether it exists, and its size."""
        self._carry_out(self._give)

    def do_PUT(self) -> None:
        """Accept a blob, or a result whose blobs are present."""
        self._carry_out(self._take)

    def log_message(self, format: str, *words: object) -> None:
        """Write a line if there is a log."""
        if self.server.log is not None:
            said = (format % words).encode("ascii", "backslashreplace").decode()
            print(f"{self.address_string()} {said}", file=self.server.log, flush=True)

    def _carry_out(self, work: Callable[[str, str], None]) -> None:
        self.server.allow(self.connection, math.inf)  # its head is here; its body has a time limit of its own
        try:
            names = self.server.names
            if "Origin" in self.headers or not (names is None or is_named(self.headers.get("Host", ""), names)):
                raise _RefusedError(HTTPStatus.FORBIDDEN, "web pages, and names of other machines, are not served")
            welcome = self.server.welcome
            if welcome and not hmac.compare_digest(self.headers.get("Authorization", "").encode(), welcome):
                raise _RefusedError(HTTPStatus.UNAUTHORIZED, "a name and a password are needed")
            match = _PATH.fullmatch(self.path)
            if match is None:
                raise _RefusedError(HTTPStatus.NOT_FOUND, "only /ac/<sha256> and /cas/<sha256> are here")
            work(match[1], match[2])
        except _RefusedError as refusal:
            self.close_connection = True
            self._answer(refusal.status, f"{refusal}\n".encode())

    def _give(self, kind: str, digest: str) -> None:
        store = self.server.store
        if kind == "ac":
            entry = store.actions.entry(digest) if store.actions.get(digest) is not None else None
            self._answer(HTTPStatus.NOT_FOUND if entry is None else HTTPStatus.OK, entry.spell() if entry else b"")
            return
        try:
            file = store.blobs.open(digest)
        except MissingBlob:
            self._answer(HTTPStatus.NOT_FOUND)
            return
        with file:
            size = file.seek(0, os.SEEK_END)
            self.server.allow(self.connection, _IDLE_S + size / _SLOWEST)
            self._head(HTTPStatus.OK, size)
            if self.command == "GET":
                file.seek(0)
                self.connection.sendfile(file)

    def _take(self, kind: str, digest: str) -> None:
        pieces = self._pieces(self._length(MOST_ENTRY if kind == "ac" else self.server.most_bytes))
        try:
            if kind == "ac":
                self._take_entry(digest, pieces)
            else:
                blobs = self.server.store.blobs
                blobs.verify(digest)  # a damaged one is moved to quarantine, and replaced by the upload
                if not blobs.receive(digest, int(self.headers["Content-Length"]), pieces):
                    raise _RefusedError(HTTPStatus.BAD_REQUEST, "these bytes have another digest")
            for _ in pieces:  # the next request begins where this one's body ends
                pass
        except EOFError:
            self.close_connection = True
        except StoreError as error:
            raise _RefusedError(HTTPStatus.INSUFFICIENT_STORAGE, error.message) from None
        else:
            self._answer(HTTPStatus.OK)

    def _take_entry(self, key: str, pieces: Iterator[bytes]) -> None:
        store = self.server.store
        with SpooledTemporaryFile(_LARGE_ENTRY, dir=str(store.root)) as message:
            for piece in pieces:
                try:
                    message.write(piece)
                except OSError as error:
                    raise files.store_error(error, str(store.root)) from None
            is_large = message.tell() > _LARGE_ENTRY
            message.seek(0)
            with self.server.reading if is_large else nullcontext():
                _publish(store, key, message.read())

    def _length(self, most: int) -> int:
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()) or "Transfer-Encoding" in self.headers:
            raise _RefusedError(HTTPStatus.LENGTH_REQUIRED, "Content-Length is needed")
        if self.server.read_only:
            raise _RefusedError(HTTPStatus.METHOD_NOT_ALLOWED, "this cache is read-only")
        if int(length) > most:
            raise _RefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"more than {most:,} bytes are not taken")
        return int(length)

    def _pieces(self, length: int) -> Iterator[bytes]:
        while length > 0:
            self.server.allow(self.connection, _IDLE_S)
            piece = self.rfile.read(min(length, _CHUNK))
            self.server.allow(self.connection, math.inf)
            if not piece:
                raise EOFError
            length -= len(piece)
            yield piece

    def _answer(self, status: HTTPStatus, data: bytes = b"") -> None:
        self._head(status, len(data))
        if self.command != "HEAD":
            self.wfile.write(data)

    def _head(self, status: HTTPStatus, length: int) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(length))
        self.send_header("Content-Type", "application/octet-stream")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()


def _publish(store: Store, key: str, message: bytes) -> None:
    """Publish an uploaded result.

    Raises:
        _RefusedError: It is not the whole result of this key.
        StoreError: The disk is full, or the store cannot be written.
    """
    try:
        entry = entries.read(message)
    except ValueError:
        raise _RefusedError(HTTPStatus.BAD_REQUEST, "this is not an entry of dxb") from None
    if entry.key != key or entry.is_bare:
        raise _RefusedError(HTTPStatus.BAD_REQUEST, "the result of another key, or a bare one")
    try:
        for file in entry.files:
            if store.blobs.size(file.digest) != file.size:
                raise MissingBlob(file.digest)
        if store.actions.get(key) is None or traces.listed(store, entry.result):
            traces.publish(store, key, entry.result)
    except MissingBlob as error:
        raise _RefusedError(HTTPStatus.BAD_REQUEST, f"blob {error.digest} is not here; blobs come first") from None
    except UNREADABLE:
        raise _RefusedError(HTTPStatus.BAD_REQUEST, "a header is damaged") from None
