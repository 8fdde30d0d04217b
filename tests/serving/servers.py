"""Servers of policies on this machine, in threads: dxb's own, and ones that misbehave as told."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection
from websockets.sync.server import serve as serve_sync

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.wire.codec import pack
from dextera_build.serving.served import Served
from dextera_build.serving.server import Server
from tests.policy import policies

HOST = "127.0.0.1"


@contextlib.contextmanager
def running(served: Served, key: str = "") -> Iterator[str]:
    """The server of dxb for a policy; gives its address."""
    told: list[Any] = []
    listens = threading.Event()

    async def run() -> None:
        told.append((asyncio.get_running_loop(), asyncio.current_task()))

        def ready(port: int) -> None:
            told.append(port)
            listens.set()

        with contextlib.suppress(asyncio.CancelledError):
            await Server(served, key).serve(HOST, 0, ready)

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    try:
        assert listens.wait(10)
        yield f"ws://{HOST}:{told[1]}"
    finally:
        loop, task = told[0]
        loop.call_soon_threadsafe(task.cancel)
        thread.join(10)
        assert not thread.is_alive()


def served(checkpoint: Checkpoint, bundle: TaskBundle) -> Served:
    """A checkpoint of the hand-made task, ready to be served."""
    return Served(policies.runner(checkpoint.contract.algorithm), checkpoint, "0" * 64, bundle)


@contextlib.contextmanager
def scripted(converse: Callable[[ServerConnection], None]) -> Iterator[str]:
    """A web socket whose every connection is handled by a function; gives its address."""

    def handle(connection: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            converse(connection)

    with serve_sync(handle, HOST, 0, compression=None, max_size=2**26, close_timeout=0.2) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"ws://{HOST}:{server.socket.getsockname()[1]}"
        finally:
            server.shutdown()
            thread.join(10)


def foreign(
    answer: Callable[[bytes], bytes | str | None], greeting: object = None
) -> Callable[[ServerConnection], None]:
    """A conversation in openpi's protocol; an answer of None ends it without one."""

    def converse(connection: ServerConnection) -> None:
        connection.send(pack({} if greeting is None else greeting))
        for data in connection:
            assert isinstance(data, bytes)
            found = answer(data)
            if found is None:
                return
            connection.send(found)

    return converse


@contextlib.contextmanager
def posted(answer: Callable[[bytes], tuple[int, bytes]]) -> Iterator[str]:
    """A server that answers POST to `/act`, as OpenVLA's does; gives its address."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self._reply(*answer(self.rfile.read(int(self.headers["Content-Length"]))))

        def do_HEAD(self) -> None:
            self._reply(405, b"")

        def _reply(self, status: int, body: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            with contextlib.suppress(OSError):
                self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer((HOST, 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/act"
    finally:
        server.shutdown()
        server.server_close()
        thread.join(10)
