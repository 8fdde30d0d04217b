"""A gRPC connection: calls with a deadline, bytes in and bytes out, and a `RemoteFault` for all that goes wrong."""

from __future__ import annotations

import uuid
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import TypeVar

import grpc

from dextera_build.store import wire
from dextera_build.store.remotes import action, credentials, execution
from dextera_build.store.remotes.remote import MOST_ENTRY, Digest, RemoteFault
from dextera_build.store.remotes.stall import Stall
from dextera_build.version import __version__

T = TypeVar("T")

_SLOWEST = 256 << 10  # bytes a second; a longer message or stream may take longer than the time-out
_NO = {"UNAUTHENTICATED", "PERMISSION_DENIED", "UNIMPLEMENTED"}


class CallFault(RemoteFault):
    """A call ended with a status other than OK.

    Args:
        address: The remote.
        reason: What happened.
        status: Name of the gRPC status: `NOT_FOUND`.
    """

    def __init__(self, address: str, reason: str, status: str) -> None:
        super().__init__(address, reason, refused=status in _NO)
        self.status = status


class Connection:
    """A channel to one server; connects when it is first used.

    Args:
        target: `host:port`, or `unix:path`.
        address: What to call the server in messages.
        secret: What stood before the `@` of the address, if anything did.
        tls: Whether the connection is encrypted.
        timeout_s: How long an answer may take [s].

    Raises:
        StoreError: The environment asks for what cannot be done.
    """

    def __init__(self, target: str, address: str, secret: str = "", *, tls: bool, timeout_s: float) -> None:
        self.address = address
        self._timeout_s = timeout_s
        self._who = (execution.Tool("dxb", __version__), str(uuid.uuid4()))
        self._secrets = credentials.metadata(target, secret, tls=tls)
        options = [
            ("grpc.max_receive_message_length", MOST_ENTRY),
            ("grpc.max_send_message_length", -1),
            ("grpc.max_reconnect_backoff_ms", 5000),
            ("grpc.primary_user_agent", "dxb"),
        ]
        if tls:
            trusted = grpc.ssl_channel_credentials(**credentials.certificates())
            self._channel = grpc.secure_channel(target, trusted, options)
        else:
            self._channel = grpc.insecure_channel(target, options)

    def ask(self, method: str, request: object, answer: type[T]) -> T:
        """One message for another.

        Raises:
            CallFault: The server, or the way to it, said no.
            RemoteFault: The answer makes no sense.
        """
        data = self.ask_bytes(method, request)
        with self._sense(method):
            return wire.decode(answer, data)

    def ask_bytes(self, method: str, request: object, key: Digest | None = None) -> bytes:
        """One message for another that is left as it is; `key` is what it is about.

        Raises:
            CallFault: The server, or the way to it, said no.
        """
        data = wire.encode(request)
        with self._faults():
            call = self._channel.unary_unary(f"/{method}")
            return bytes(call(data, timeout=self._deadline(len(data)), metadata=self._metadata(key)))

    def read(self, method: str, request: object, answer: type[T], size: int) -> Generator[T, None, None]:
        """One message for many, `size` bytes in all; the call ends when the iterator is closed.

        Raises:
            CallFault: The server, or the way to it, said no, or nothing came for too long.
            RemoteFault: The answer makes no sense.
        """
        with self._faults():
            call = self._channel.unary_stream(f"/{method}")(
                wire.encode(request), timeout=self._deadline(size), metadata=self._metadata()
            )
        with Stall(call.cancel, self._timeout_s) as stall:
            try:
                while True:
                    with self._faults(stall), stall.waiting():
                        data = next(call, None)
                    if data is None:
                        return
                    with self._sense(method):
                        message = wire.decode(answer, data)
                    yield message
            finally:
                call.cancel()

    def write(self, method: str, requests: Iterator[object], answer: type[T], size: int) -> T:
        """Many messages, `size` bytes in all, for one; the server may answer before it got all.

        Raises:
            CallFault: The server, or the way to it, said no, or nothing was taken for too long.
            RemoteFault: The answer makes no sense.
        """
        with Stall(lambda: call.cancel(), self._timeout_s) as stall:

            def outgoing() -> Iterator[bytes]:
                for request in requests:
                    data = wire.encode(request)
                    with stall.waiting():
                        yield data

            with self._faults(stall):
                stream = self._channel.stream_unary(f"/{method}")
                call = stream.future(outgoing(), timeout=self._deadline(size), metadata=self._metadata())
                with stall.waiting():
                    data = call.result()
        with self._sense(method):
            return wire.decode(answer, data)

    def close(self) -> None:
        """Let the connection go; calls under way end with a fault."""
        self._channel.close()

    def _metadata(self, key: Digest | None = None) -> list[tuple[str, str | bytes]]:
        return [action.metadata(*self._who, key), *self._secrets]

    def _deadline(self, size: int) -> float:
        return self._timeout_s + size / _SLOWEST

    @contextmanager
    def _faults(self, stall: Stall | None = None) -> Iterator[None]:
        try:
            yield
        except (grpc.RpcError, grpc.FutureCancelledError, grpc.FutureTimeoutError) as error:
            status = error.code().name if isinstance(error, grpc.Call) else "CANCELLED"
            details = (error.details() or "") if isinstance(error, grpc.Call) else ""
            if status == "DEADLINE_EXCEEDED" or (stall is not None and stall.happened):
                status, details = "DEADLINE_EXCEEDED", f"nothing came in {self._timeout_s:g} s"
            raise CallFault(self.address, _reason(status, details), status) from None
        except ValueError as error:  # the channel was closed meanwhile
            raise CallFault(self.address, _reason("CANCELLED", str(error)), "CANCELLED") from None

    @contextmanager
    def _sense(self, method: str) -> Iterator[None]:
        try:
            yield
        except ValueError as error:
            what = method.rpartition("/")[2]
            raise RemoteFault(self.address, f"the answer to `{what}` makes no sense: {error}") from None


def _reason(status: str, details: str) -> str:
    said = {
        "UNAVAILABLE": "no connection",
        "DEADLINE_EXCEEDED": "no answer in time",
        "CANCELLED": "the connection was closed",
        "UNAUTHENTICATED": "it does not know who asks; set `DXB_REMOTE_TOKEN`",
        "PERMISSION_DENIED": "it does not allow that",
        "UNIMPLEMENTED": "it does not know that call",
    }.get(status, f"it says {status}")
    line = " ".join(details.split())[:200]
    return f"{said} ({line})" if line else said
