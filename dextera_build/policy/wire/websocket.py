"""The protocol of openpi: a web socket, the server's metadata first, then an answer to each request.

[openpi: src/openpi/serving/websocket_policy_server.py, packages/openpi-client/.../websocket_client_policy.py]
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Mapping
from socket import SO_SNDTIMEO, SOL_SOCKET
from typing import Any

from dextera_build.errors import MachineError, install_extra
from dextera_build.policy.wire import link
from dextera_build.policy.wire.codec import MessageError, pack, unpack
from dextera_build.redact import hide

TOO_LARGE = 1009
"""Code with which a connection is closed that carried too large a message."""


class WebSocket:
    """A connection to a policy's server.

    Args:
        address: `ws://HOST:PORT` or `wss://HOST:PORT`.
        key: Sent as `Authorization: Api-Key`; empty: none.

    Raises:
        MachineError: Nothing answers there, or it refuses this client.
    """

    def __init__(self, address: str, key: str = "") -> None:
        connect, self._wrong = _websockets()
        self._address = address
        if key:
            hide("the key of a policy's server", key)
        try:
            # Servers of openpi do not answer pings while they compute, so only answers have a time limit.
            self._connection = connect(
                address,
                additional_headers={"Authorization": f"Api-Key {key}"} if key else None,
                compression=None,
                max_size=link.LARGEST,
                open_timeout=link.CONNECT_S,
                close_timeout=1,
                ping_interval=None,
                proxy=None,
            )
        except self._wrong.InvalidStatus as error:
            raise _refused(address, error.response.status_code, key) from None
        except (OSError, self._wrong.WebSocketException, ValueError, EOFError) as error:
            raise link.unreachable(address, error) from None
        self.greeting = self._greeted()

    def _greeted(self) -> bytes:
        try:
            greeting = self._connection.recv(timeout=link.CONNECT_S)
        except TimeoutError:
            reason: object = f"no metadata came in {link.CONNECT_S:g} s"
        except self._wrong.ConnectionClosed as closed:
            reason = closed
        else:
            if isinstance(greeting, bytes):
                return greeting
            reason = greeting
        self.close()
        raise link.unreachable(self._address, reason)

    def ask(self, request: Mapping[str, Any], limit_s: float) -> Mapping[str, Any]:
        """The answer to a request; see `link.Link`.

        Raises:
            PolicyFault: There is no answer, or it is none of this protocol.
        """
        try:
            # `recv` has a limit of its own; a peer that does not read would stop `send` for ever.
            limit = struct.pack("ll", int(limit_s), int(limit_s % 1 * 1e6))
            self._connection.socket.setsockopt(SOL_SOCKET, SO_SNDTIMEO, limit)
            self._connection.send(pack(request))
            answer = self._connection.recv(timeout=limit_s)
        except TimeoutError:
            raise link.late(self._address, limit_s) from None
        except self._wrong.ConnectionClosed as closed:
            if closed.sent is not None and closed.sent.code == TOO_LARGE and not closed.rcvd_then_sent:
                link.too_large(self._address, "an answer of")
            if closed.rcvd is not None and closed.rcvd.code == TOO_LARGE:
                link.too_large(self._address, "a request to")
            raise link.lost(self._address, closed) from None
        except OSError as error:
            raise link.lost(self._address, error) from None
        if isinstance(answer, str):
            raise link.failed(self._address, answer)
        return _map(self._address, answer)

    def close(self) -> None:
        """End the connection."""
        with contextlib.suppress(OSError, self._wrong.WebSocketException):
            self._connection.close()


def _map(address: str, answer: bytes) -> Mapping[str, Any]:
    try:
        found = unpack(answer)
    except MessageError as error:
        raise link.unusable(address, "is no message", reason=error) from None
    if not isinstance(found, dict):
        raise link.unusable(address, "is no map", type=type(found).__name__)
    return found


def _refused(address: str, status: int, key: str) -> MachineError:
    if status not in (401, 403):
        return link.unreachable(address, f"HTTP status {status}")
    hint = "`key_in: NAME`, and the server's key in the environment variable NAME"
    return link.unreachable(address, "it refuses the key" if key else "it asks for a key", hint)


def _websockets() -> tuple[Any, Any]:
    """What opens web sockets, and the module of its exceptions.

    Raises:
        MachineError: websockets is not installed.
    """
    try:
        import msgspec  # noqa: F401 - messages need it
        from websockets import exceptions
        from websockets.sync.client import connect
    except ImportError as error:
        raise MachineError(
            f"a policy elsewhere needs {error.name}, which is not installed",
            code="DXB-E329",
            hint=install_extra("serve"),
        ) from None
    return connect, exceptions
