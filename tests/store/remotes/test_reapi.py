"""The Remote Execution API as a remote, against servers that do well, badly, or nothing."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from typing import Any

import grpc
import pytest

from dextera_build.store import wire
from dextera_build.store.reapi import OutputFile, encode
from dextera_build.store.remotes import action
from dextera_build.store.remotes import protocol as api
from dextera_build.store.remotes.reapi import Reapi
from dextera_build.store.remotes.remote import Digest, RemoteFault
from dextera_build.store.store import Store
from tests.store.remotes.grpc_servers import KEY, connected, scripted
from tests.store.remotes.things import Blobs, blob, digest_of


def test_blobs_of_every_size_go_and_come(remote: Reapi) -> None:
    edge = api.BATCH - 128
    sizes = [0, 1, 1000, edge - 1, edge, edge + 1, api.BATCH, 3 * api.PIECE + 17]
    blobs = Blobs(*(blob(size) for size in sizes), *(blob(100, seed) for seed in range(1200)))
    assert remote.missing([*blobs, *blobs]) == set(blobs) - {digest_of(b"")}
    remote.send([*blobs, *blobs], blobs.give)
    assert blobs.opened == len(blobs)
    assert remote.missing(list(blobs)) == set()
    came = Blobs()
    remote.fetch([*blobs, *blobs], came.take)
    assert came == blobs


def test_what_the_server_lacks_is_left_out(remote: Reapi, store: Store) -> None:
    small, large = Blobs(b"a", b"b"), Blobs(blob(5 << 20))
    store.blobs.put(b"a")
    came = Blobs()
    remote.fetch([*small, *large], came.take)
    assert came == Blobs(b"a")
    other_size = Digest(digest_of(b"a").hash, 2)
    assert remote.missing([digest_of(b"a"), other_size]) == {other_size}
    remote.fetch([other_size, Digest(digest_of(b"a").hash, 9 << 20)], came.take)
    assert came == Blobs(b"a")


def test_results_are_found_by_key(remote: Reapi, store: Store) -> None:
    store.blobs.put(b"content")
    message = encode([OutputFile("output", digest_of(b"content").hash, 7)])
    assert remote.get_action(KEY) is None
    remote.put_action(KEY, message)
    assert remote.get_action(KEY) == message
    assert (store.root / "foreign" / KEY.hash[:2] / KEY.hash[2:]).read_bytes() == message
    assert all(store.blobs.has(digest.hash) for digest in action.of_key(KEY).blobs)


def test_the_limit_of_the_server_is_kept(store: Store) -> None:
    limit, seen, streamed = 2000, list[int](), list[int]()

    def update(request: bytes, context: Any) -> bytes:
        uploads = wire.decode(api.BatchUpdateBlobsRequest, request).requests
        seen.append(sum(upload.digest.size for upload in uploads))
        return wire.encode(api.BatchUpdateBlobsResponse(tuple(api.Stored(upload.digest) for upload in uploads)))

    def write(requests: Iterator[bytes], context: Any) -> bytes:
        streamed.append(sum(len(wire.decode(api.WriteRequest, request).data) for request in requests))
        return wire.encode(api.WriteResponse(streamed[-1]))

    small = api.ServerCapabilities(api.CacheCapabilities((1,), api.UpdateCapabilities(True), limit))
    script = {"GetCapabilities": lambda *_: wire.encode(small), "BatchUpdateBlobs": update, "Write": write}
    blobs = Blobs(*(blob(700, seed) for seed in range(9)), blob(1999), blob(2001))
    with scripted(script) as port, connected(port) as remote:
        remote.send(list(blobs), blobs.give)
    assert len(seen) == 5
    assert max(seen) <= limit
    assert sorted(streamed) == [1999, 2001]


def test_an_upload_goes_on_from_what_arrived() -> None:
    data, offsets = blob(6 << 20), list[int]()
    digest, held = digest_of(data), bytearray()

    def write(requests: Iterator[bytes], context: Any) -> bytes:
        for place in itertools.count():
            request = wire.decode(api.WriteRequest, next(requests))
            if place == 0:
                offsets.append(request.write_offset)
            assert request.write_offset == len(held)
            held.extend(request.data)
            if request.finish_write:
                return wire.encode(api.WriteResponse(len(held)))
            if place == 1:
                context.abort(grpc.StatusCode.UNAVAILABLE, "going down")
        raise AssertionError

    def status(request: bytes, context: Any) -> bytes:
        return wire.encode(api.QueryWriteStatusResponse(len(held)))

    with scripted({"Write": write, "QueryWriteStatus": status}) as port, connected(port) as remote:
        remote.send([digest], Blobs(data).give)
    assert held == data
    assert offsets == [0, 2 << 20, 4 << 20]


def test_an_upload_that_another_finished_ends_early() -> None:
    data = blob(32 << 20)

    def write(requests: Iterator[bytes], context: Any) -> bytes:
        next(requests)
        return wire.encode(api.WriteResponse(len(data)))

    with scripted({"Write": write}) as port, connected(port) as remote:
        remote.send([digest_of(data)], Blobs(data).give)


def test_a_download_goes_on_where_it_broke() -> None:
    data, offsets = blob(6 << 20), list[int]()

    def read(request: bytes, context: Any) -> Iterator[bytes]:
        start = wire.decode(api.ReadRequest, request).read_offset
        offsets.append(start)
        yield wire.encode(api.ReadResponse(data[start : start + (2 << 20)]))
        if start < 4 << 20:
            context.abort(grpc.StatusCode.UNAVAILABLE, "going down")

    came = Blobs()
    with scripted({"Read": read}) as port, connected(port) as remote:
        remote.fetch([digest_of(data)], came.take)
    assert came == Blobs(data)
    assert offsets == [0, 2 << 20, 4 << 20]


def test_whoever_takes_may_stop_and_may_be_slow(remote: Reapi, store: Store) -> None:
    data = blob(6 << 20)
    store.blobs.put(data)
    got = list[int]()

    def take_one(digest: Digest, pieces: Iterator[bytes]) -> None:
        got.append(len(next(pieces)))

    remote.fetch([digest_of(data)], take_one)
    assert got == [api.PIECE]
    with connected(int(remote.address.rpartition(":")[2]), timeout_s=1.5) as hasty:

        def take_slowly(digest: Digest, pieces: Iterator[bytes]) -> None:
            for piece in pieces:
                time.sleep(0.4)
                got.append(len(piece))

        hasty.fetch([digest_of(data)], take_slowly)
    assert sum(got) == len(data) + api.PIECE


def test_what_the_caller_raises_comes_back_to_it(remote: Reapi, store: Store) -> None:
    large = Blobs(blob(5 << 20))

    class Mine(Exception):  # noqa: N818 - what a caller may raise
        """An error of the caller."""

    class Broken:
        """A file whose disk fails."""

        def __enter__(self) -> Broken:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def seek(self, offset: int) -> None:
            pass

        def read(self, size: int) -> bytes:
            raise Mine

    def take(digest: Digest, pieces: Iterator[bytes]) -> None:
        raise Mine

    def give(digest: Digest) -> Any:
        return Broken()

    store.blobs.put(b"here")
    for digests in ([digest_of(b"x")], list(large)):
        with pytest.raises(Mine):
            remote.send(digests, give)
    with pytest.raises(Mine):
        remote.fetch([digest_of(b"here")], take)


def test_a_blob_that_is_not_what_its_name_says_is_not_taken(remote: Reapi, store: Store) -> None:
    for data in (b"right", blob(5 << 20)):
        wrong = {digest_of(data): data[:-1] + b"?"}
        with pytest.raises(RemoteFault, match=r"INVALID_ARGUMENT|status 3"):
            remote.send(list(wrong), lambda digest, wrong=wrong: Blobs(wrong[digest]).give(digest_of(wrong[digest])))
        assert not store.blobs.has(digest_of(data).hash)
