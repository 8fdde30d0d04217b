"""The server of a policy: openpi's protocol on web sockets, one episode per connection."""

from __future__ import annotations

import asyncio
import hmac
import http
import logging
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

from dextera_build.errors import DxbError, MachineError, RuleError, UsageError, install_extra
from dextera_build.policy.wire.codec import MessageError, pack, unpack
from dextera_build.policy.wire.link import LARGEST
from dextera_build.redact import redact
from dextera_build.serving.served import Episode, Served

HEALTH = "/healthz"
MOST = 16
"""Connections at a time; each has the network in memory."""
ERROR, BUSY = 1011, 1013
"""Codes with which a connection is closed: after an error; too many connections."""
WHY = "the text before says why"

T = TypeVar("T")
_LOG = logging.getLogger(__name__)
_LOG.addHandler(logging.NullHandler())  # a port scanner is no reason to print a traceback
_LOG.propagate = False


class Server:
    """Serves one policy.

    Args:
        served: The policy.
        key: What clients send as `Authorization: Api-Key`; empty: anyone is served.
    """

    def __init__(self, served: Served, key: str = "") -> None:
        self._served, self._key = served, key
        self._greeting = pack(served.promise.message())
        self._open = 0
        # One prediction at a time: torch's settings of threads belong to the process.
        self._turns = ThreadPoolExecutor(1, "policy")

    async def serve(self, host: str, port: int, ready: Callable[[int], None]) -> None:
        """Serve until cancelled.

        Args:
            host: Address to listen on.
            port: Port to listen on; 0: any.
            ready: Called with the port once the server listens.

        Raises:
            UsageError: The address or the port cannot be listened on.
        """
        serve, _ = _websockets()
        try:
            server = await serve(
                self._converse,
                host,
                port,
                process_request=self._request,
                max_size=LARGEST,
                max_queue=2,
                compression=None,
                close_timeout=1,
                server_header=None,
                logger=_LOG,
            )
        except (OSError, OverflowError) as error:
            raise UsageError(
                f"cannot listen on `{host}` port {port}",
                code="DXB-U341",
                facts={"system": getattr(error, "strerror", None) or error},
                hint="choose another port by `--port`, or an address of this machine by `--host`",
            ) from None
        try:
            async with server:
                ready(server.sockets[0].getsockname()[1])
                # `serve_forever`, cancelled, would wait from Python 3.12 on until all clients have left by themselves.
                await asyncio.Future()
        finally:
            self._turns.shutdown(wait=False, cancel_futures=True)

    def _request(self, connection: Any, request: Any) -> Any:
        """Answer a request that opens no conversation; None for one that does."""
        if request.path == HEALTH:
            return connection.respond(http.HTTPStatus.OK, "OK\n")
        if request.headers.get_all("Origin"):
            # Any page may open a web socket to this machine, and browsers then name the page.
            return connection.respond(http.HTTPStatus.FORBIDDEN, "dxb serve does not answer pages of a browser\n")
        sent = "".join(request.headers.get_all("Authorization"))
        if self._key and not hmac.compare_digest(sent.encode(errors="replace"), f"Api-Key {self._key}".encode()):
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "send `Authorization: Api-Key KEY`\n")
        return None

    async def _converse(self, connection: Any) -> None:
        """One connection, from the greeting to its end; after an error it ends."""
        if self._open >= MOST:
            await connection.close(BUSY, f"{MOST} clients are connected")
            return
        self._open += 1
        _, closed = _websockets()
        try:
            try:
                episode = await self._in_turn(partial(Episode, self._served))
            except Exception as error:
                await connection.send(_told(error))
                await connection.close(ERROR, WHY)
                return
            await connection.send(self._greeting)
            before_ms: float | None = None
            async for data in connection:
                began = time.perf_counter()
                answer = await self._in_turn(partial(_answer, episode, data, before_ms))
                await connection.send(answer)
                if isinstance(answer, str):
                    await connection.close(ERROR, WHY)
                before_ms = (time.perf_counter() - began) * 1000
        except closed:
            pass
        finally:
            self._open -= 1

    async def _in_turn(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._turns, work)


def _answer(episode: Episode, data: bytes | str, before_ms: float | None) -> bytes | str:
    """The answer to a message, or the text of an error.

    Args:
        episode: The episode of the connection.
        data: The message.
        before_ms: Duration of the request before, sending included [ms].
    """
    began = time.perf_counter()
    try:
        if isinstance(data, str):
            raise RuleError("a request is a binary message, not text", code="DXB-B547")
        answer = episode.answer(unpack(data))
        timing = {"infer_ms": (time.perf_counter() - began) * 1000}
        return pack(answer | {"server_timing": timing | ({} if before_ms is None else {"prev_total_ms": before_ms})})
    except Exception as error:
        return _told(error)


def _told(error: Exception) -> str:
    """The text of an error for a client."""
    if isinstance(error, MessageError):
        return f"a request is a map in msgpack, this is none: {error}"
    return str(error) if isinstance(error, DxbError) else redact("".join(traceback.format_exception(error)))


def _websockets() -> tuple[Any, type[Exception]]:
    """What serves web sockets, and the exception of a connection that was closed.

    Raises:
        MachineError: websockets is not installed.
    """
    try:
        import msgspec  # noqa: F401 - messages need it
        from websockets.asyncio.server import serve
        from websockets.exceptions import ConnectionClosed
    except ImportError as error:
        raise MachineError(
            f"a policy's server needs {error.name}, which is not installed",
            code="DXB-E329",
            hint=install_extra("serve"),
        ) from None
    return serve, ConnectionClosed
