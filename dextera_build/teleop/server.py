"""The web server of a session: the page, the twin, and a web socket for one operator."""

from __future__ import annotations

import asyncio
import http
import json
import logging
import secrets
import ssl
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from dextera_build.errors import MachineError, UsageError, install_extra
from dextera_build.sim.experts.live_operator import Message, Refused
from dextera_build.teleop import protocol
from dextera_build.teleop.delay import Delays
from dextera_build.teleop.session import Session
from dextera_build.view.guard import Guard

PAGE = "dextera_build.teleop.page"
KINDS = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
}
POLICY = "default-src 'self'; img-src 'self' blob: data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'"
MOST_HZ = 240.0
"""Messages per second of an operator that are read; a headset sends 72 to 120."""
BURST = 60.0
"""Messages that may come at once, after a stall of the network."""
BUSY, RATE = 4001, 4002
"""Codes with which a connection is closed: another operator is there; too many messages."""
ANSWER_S, STUCK_S = 2.0, 5.0
"""Time in which an operator must answer when another one comes, and after which one that reads nothing has left [s]."""
WISHES = ("start", "finish", "discard", "undo", "skip", "recentre", "measure", "end")
MOST_MEASURED = 200


class Allowance:
    """A rate of messages: a bucket that fills with `MOST_HZ` and holds `BURST`."""

    def __init__(self) -> None:
        self._left, self._last = BURST, time.perf_counter()
        self.excess = 0
        """Messages beyond the rate since the bucket was last full."""

    def spend(self, now: float) -> bool:
        """Whether a message at a time [s] is within the rate."""
        self._left = min(BURST, self._left + (now - self._last) * MOST_HZ)
        self._last = now
        if self._left >= BURST:
            # Single messages are within the rate in any flood, so they do not end one; a pause does.
            self.excess = 0
        if self._left < 1:
            self.excess += 1
            return False
        self._left -= 1
        return True


class Server:
    """Serves one session.

    Args:
        host: Address to listen on.
        origins: Further origins whose pages may connect, see `view.guard`.
        encryption: What HTTPS needs; None: plain HTTP.

    Raises:
        UsageError: One of `origins` is no origin.
    """

    def __init__(self, host: str, origins: Sequence[str] = (), encryption: ssl.SSLContext | None = None) -> None:
        self._host, self._encryption, self._guard = host, encryption, Guard(host, origins)
        self.token = secrets.token_urlsafe(16)
        """First part of every path: who does not know it gets nothing."""
        self.whole_way, self.round_trip = Delays(), Delays()
        """From a message of the page to the state that it led to, and of an empty message, both by the page [ms]."""
        self.refused = 0
        """Frames of hands that did not follow the protocol."""
        self.session: Session
        self._operator: Any = None
        self._heard = 0.0
        self._newest: bytes | None = None
        self._told: set[str] = set()

    def publish(self, state: bytes) -> None:
        """Show a state to the operator, from any thread; one that was not sent yet is replaced."""
        self._newest = state
        if self._operator is not None:
            self._loop.call_soon_threadsafe(self._changed.set)

    async def serve(self, session: Session, port: int, ready: Any) -> None:
        """Serve until the session ends.

        Args:
            session: What the pages show.
            port: Port to listen on; 0: any.
            ready: Called with the address once the server listens.

        Raises:
            UsageError: The address or the port cannot be listened on.
        """
        serve, _ = _websockets()
        self.session, self._loop, self._changed = session, asyncio.get_running_loop(), asyncio.Event()
        try:
            server = await serve(
                self._operate,
                self._host,
                port,
                ssl=self._encryption,
                process_request=self._request,
                max_size=protocol.LARGEST,
                max_queue=4,
                compression=None,
                ping_interval=5,
                ping_timeout=5,
                close_timeout=1,
                server_header=None,
                logger=_quiet(),
            )
        except OSError as error:
            raise UsageError(
                f"cannot listen on `{self._host}` port {port}",
                code="DXB-U332",
                facts={"system": error.strerror or str(error)},
                hint="choose another port by `--port`, or an address of this machine by `--host`",
            ) from None
        async with server:
            listening = server.sockets[0].getsockname()[1]
            ready(listening)
            session.start()
            while session.is_alive():
                await asyncio.sleep(0.1)

    def path(self) -> str:
        """Path of the page."""
        return f"/{self.token}/"

    def _request(self, connection: Any, request: Any) -> Any:
        """Answer with a file, refuse, or go on to the web socket."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        refused = "a request without one host" if len(hosts) != 1 or len(origins) > 1 else ""
        if refused := refused or self._guard.refusal(hosts[0], origins[0] if origins else None):
            self._tell(f"refused: {refused}")
            return _answer(http.HTTPStatus.FORBIDDEN, b"dxb teleop does not serve this page\n")
        _, token, *rest = (*urlsplit(request.path).path.split("/"), "")[:4]
        if not secrets.compare_digest(token.encode(errors="surrogateescape"), self.token.encode()):
            self._tell("refused: an address without this session's token")
            return _answer(http.HTTPStatus.NOT_FOUND, b"open the address that dxb teleop printed\n")
        name = rest[0] or "index.html"
        if name == "socket":
            return None
        if name == "twin":
            return _answer(http.HTTPStatus.OK, self.session.twin, "application/octet-stream")
        return _file(name)

    def _tell(self, text: str) -> None:
        if text not in self._told and len(self._told) < 20:
            self._told.add(text)
            print(text, file=sys.stderr)

    async def _operate(self, connection: Any) -> None:
        """Let one operator in; a second one is told so, unless the first has left without a word."""
        first = self._operator
        if first is not None and not await self._answers(first):
            first.transport.abort()
            if self._operator is first:
                self._operator = None
        if self._operator is not None:
            await connection.close(BUSY, "another operator is connected")
            return
        self._operator = connection
        self.session.connected = True
        sender = asyncio.create_task(self._send(connection))
        _, closed = _websockets()
        try:
            await self._hear(connection)
        except closed:
            pass
        finally:
            sender.cancel()
            # Another operator may have its place already.
            if self._operator is connection:
                self._operator, self.session.connected = None, False

    async def _answers(self, connection: Any) -> bool:
        """Whether an operator is still there: it sends something, or answers a ping, within `ANSWER_S`."""
        heard = self._heard
        _, closed = _websockets()
        try:
            async with asyncio.timeout(ANSWER_S):
                await (await connection.ping())
        except TimeoutError:
            return self._heard > heard
        except closed:
            return False
        return True

    async def _send(self, connection: Any) -> None:
        while True:
            self._changed.clear()
            if self._newest is not None:
                try:
                    async with asyncio.timeout(STUCK_S):
                        await connection.send(self._newest)
                except TimeoutError:
                    # Pings would wait behind these states without end.
                    connection.transport.abort()
                    return
            await self._changed.wait()

    async def _hear(self, connection: Any) -> None:
        allowance = Allowance()
        async for data in connection:
            arrived = self._heard = time.perf_counter()
            if not allowance.spend(arrived):
                if allowance.excess > MOST_HZ:
                    await connection.close(RATE, f"more than {MOST_HZ:g} messages per second")
                continue
            if isinstance(data, bytes):
                if self.session.camera:
                    continue  # hands come from elsewhere
                self.session.inbox.put(partial(self._read, data, arrived))
                continue
            try:
                answer = self._command(protocol.command(data))
            except Refused as refused:
                answer = {"refused": str(refused)}
            if answer is not None:
                await connection.send(json.dumps(answer))

    def _read(self, data: bytes, arrived: float) -> Message:
        """Read a frame of hands, in the session's thread; a refusal is told to the operator.

        Raises:
            Refused: It does not follow the protocol.
        """
        try:
            frame = protocol.frame(data, arrived, self.session.heading_rad)
        except Refused as refused:
            self.refused += 1
            asyncio.run_coroutine_threadsafe(self._refuse(str(refused)), self._loop)
            raise
        self.session.measure.of(measured=frame.measured)
        return frame.message

    async def _refuse(self, text: str) -> None:
        if self._operator is not None:
            await self._operator.send(json.dumps({"refused": text}))

    def _command(self, command: Mapping[str, Any]) -> dict[str, Any] | None:
        """Carry out a command of the page, and answer it if it asks for an answer."""
        if "ping" in command:
            return {"pong": command["ping"]}
        if command.get("do") in WISHES:
            self.session.wish(command["do"])
        elif "device" in command:
            if self.session.camera:
                return None
            letters = [letter for letter in str(command["device"])[:160] if letter.isprintable()]
            self.session.takes.device = "".join(letters).strip() or "not known"
        elif "way" in command or "trip" in command:
            self.whole_way.add(_numbers(command.get("way")))
            self.round_trip.add(_numbers(command.get("trip")))
        else:
            raise Refused("a command is `do`, `device`, `ping`, or delays `way` and `trip`")
        return None


def _quiet() -> logging.Logger:
    """A log that nobody reads: devices that leave or refuse the certificate would fill the terminal by tracebacks."""
    found = logging.getLogger(f"{__name__}.sockets")
    found.addHandler(logging.NullHandler())
    found.propagate = False
    return found


def _numbers(values: Any) -> list[float]:
    """Delays of a page [ms], as far as they are such."""
    if not isinstance(values, list):
        return []
    return [float(each) for each in values[:MOST_MEASURED] if isinstance(each, int | float) and 0 <= each < 60_000]


def _file(name: str) -> Any:
    """A file of the page."""
    kind = KINDS.get(name.rpartition(".")[2])
    file = resources.files(PAGE) / name
    if kind is None or not file.is_file():
        return _answer(http.HTTPStatus.NOT_FOUND, b"no such file\n")
    return _answer(http.HTTPStatus.OK, file.read_bytes(), kind)


def _answer(status: http.HTTPStatus, body: bytes, kind: str = "text/plain; charset=utf-8") -> Any:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Connection": "close",
            "Cache-Control": "no-store",
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
        }
    )
    return Response(status.value, status.phrase, headers, body)


def _websockets() -> tuple[Any, type[Exception]]:
    """What serves web sockets, and the exception of a connection that was closed.

    Raises:
        MachineError: websockets is not installed.
    """
    try:
        from websockets.asyncio.server import serve
        from websockets.exceptions import ConnectionClosed
    except ImportError:
        raise MachineError(
            "a live session needs websockets, which is not installed",
            code="DXB-E326",
            hint=install_extra("teleop"),
        ) from None
    return serve, ConnectionClosed
