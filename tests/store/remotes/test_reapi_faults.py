"""Whatever a server of the Remote Execution API does wrongly, or does not do, is a `RemoteFault` in time."""

from __future__ import annotations

import itertools
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from dextera_build.store import wire
from dextera_build.store.remotes import protocol as api
from dextera_build.store.remotes.grpc_server import GrpcServer
from dextera_build.store.remotes.reapi import Reapi
from dextera_build.store.remotes.remote import RemoteFault
from tests.store.remotes.grpc_servers import ALL_GOOD, KEY, connected, scripted
from tests.store.remotes.servers import deaf_port
from tests.store.remotes.things import Blobs, blob, digest_of


def calls(remote: Reapi) -> list[Callable[[], object]]:
    large = Blobs(blob(5 << 20))
    return [
        lambda: remote.get_action(KEY),
        lambda: remote.put_action(KEY, b""),
        lambda: remote.missing([KEY]),
        lambda: remote.fetch([KEY], Blobs().take),
        lambda: remote.fetch(list(large), Blobs().take),
        lambda: remote.send([digest_of(b"x")], Blobs(b"x").give),
        lambda: remote.send(list(large), large.give),
    ]


def test_a_server_that_is_not_there_is_a_fault() -> None:
    with deaf_port() as port, connected(port) as remote:
        for call in calls(remote):
            with pytest.raises(RemoteFault, match="no connection") as caught:
                call()
            assert not caught.value.refused


def test_a_server_that_says_nothing_is_a_fault_in_time() -> None:
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))
        deaf.listen()
        with connected(deaf.getsockname()[1], timeout_s=0.3) as remote:
            for call in calls(remote):
                begun = time.monotonic()
                with pytest.raises(RemoteFault):
                    call()
                assert time.monotonic() - begun < 20


def test_a_server_that_stops_is_a_fault(server: GrpcServer, remote: Reapi) -> None:
    assert remote.missing([KEY]) == {KEY}
    server.stop(0)
    for call in calls(remote):
        with pytest.raises(RemoteFault):
            call()


def test_closing_ends_calls_that_wait() -> None:
    entered, leave = threading.Event(), threading.Event()

    def wait(request: bytes, context: Any) -> bytes:
        entered.set()
        leave.wait(20)
        return b""

    with scripted({"GetActionResult": wait}) as port, connected(port, timeout_s=20) as remote:
        threading.Thread(target=lambda: (entered.wait(20), remote.close())).start()
        with pytest.raises(RemoteFault, match="the connection was closed"):
            remote.get_action(KEY)
        leave.set()
        with pytest.raises(RemoteFault, match="the connection was closed"):
            remote.get_action(KEY)


def test_a_server_that_answers_nonsense_is_a_fault() -> None:
    nonsense = {name: lambda request, context: b"\xff\xff" for name in ("FindMissingBlobs", "BatchReadBlobs")}
    stream = {
        "Read": lambda request, context: iter([b"\x07"]),
        "Write": lambda requests, context: b"\x08",
        "BatchUpdateBlobs": lambda request, context: b"",
    }
    with scripted({**nonsense, **stream}) as port, connected(port) as remote:
        for call in calls(remote)[2:]:
            with pytest.raises(RemoteFault, match=r"makes no sense|does not say what became of"):
                call()


@pytest.mark.parametrize(
    ("capabilities", "reason"),
    [
        (api.ServerCapabilities(), "keeps no blobs by SHA-256"),
        (api.ServerCapabilities(api.CacheCapabilities((9,))), "keeps no blobs by SHA-256"),
        (api.ServerCapabilities(ALL_GOOD.cache, api.SemVer(3), api.SemVer(3)), "does not speak version 2"),
    ],
)
def test_a_server_that_cannot_do_what_we_need_is_refused(capabilities: object, reason: str) -> None:
    answer = {"GetCapabilities": lambda request, context: wire.encode(capabilities)}
    with scripted(answer) as port, connected(port) as remote:
        for call in calls(remote):
            with pytest.raises(RemoteFault, match=reason) as caught:
                call()
            assert caught.value.refused


def test_a_read_only_server_takes_no_results() -> None:
    only_read = api.ServerCapabilities(api.CacheCapabilities((1,)))
    with scripted({"GetCapabilities": lambda *_: wire.encode(only_read)}) as port, connected(port) as remote:
        with pytest.raises(RemoteFault, match="takes no results") as caught:
            remote.put_action(KEY, b"")
        assert caught.value.refused


def test_an_upload_that_never_arrives_is_a_fault() -> None:
    def write(requests: Iterator[bytes], context: Any) -> bytes:
        return wire.encode(api.WriteResponse(sum(1 for _ in requests)))

    blobs = Blobs(blob(5 << 20))
    with scripted({"Write": write}) as port, connected(port) as remote, pytest.raises(RemoteFault, match="it took"):
        remote.send(list(blobs), blobs.give)


def test_a_download_that_does_not_end_is_a_fault() -> None:
    def read(request: bytes, context: Any) -> Iterator[bytes]:
        return itertools.repeat(wire.encode(api.ReadResponse(b"x" * (1 << 20))))

    with scripted({"Read": read}) as port, connected(port) as remote, pytest.raises(RemoteFault, match="does not end"):
        remote.fetch([digest_of(blob(5 << 20))], Blobs().take)


def test_a_transfer_that_stands_still_is_a_fault() -> None:
    data, leave = blob(5 << 20), threading.Event()

    def read(request: bytes, context: Any) -> Iterator[bytes]:
        yield wire.encode(api.ReadResponse(data[:100]))
        leave.wait(60)

    def write(requests: Iterator[bytes], context: Any) -> bytes:
        next(requests)
        leave.wait(60)
        return b""

    with scripted({"Read": read, "Write": write}) as port, connected(port, timeout_s=0.5) as remote:
        for call in (
            lambda: remote.fetch([digest_of(data)], Blobs().take),
            lambda: remote.send([digest_of(data)], Blobs(data).give),
        ):
            begun = time.monotonic()
            with pytest.raises(RemoteFault, match=r"nothing came in 0\.5 s"):
                call()
            assert time.monotonic() - begun < 50
        leave.set()
