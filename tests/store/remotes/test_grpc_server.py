"""A store as a server of the Remote Execution API, asked by clients that are right, wrong or hostile."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import grpc
import pytest

from dextera_build.errors import StoreError
from dextera_build.store import wire
from dextera_build.store.reapi import OutputFile, encode
from dextera_build.store.remotes import action, execution, resource
from dextera_build.store.remotes import protocol as api
from dextera_build.store.remotes.channel import CallFault, Connection
from dextera_build.store.remotes.grpc_server import GrpcServer, serve_grpc
from dextera_build.store.remotes.reapi import Reapi
from dextera_build.store.remotes.remote import Digest, RemoteFault
from dextera_build.store.store import Store
from tests.store.remotes.grpc_servers import KEY, connected
from tests.store.remotes.things import Blobs, blob, digest_of

WRITE, READ = f"{api.BYTE_STREAM}/Write", f"{api.BYTE_STREAM}/Read"
GET, UPDATE = f"{api.ACTION_CACHE}/GetActionResult", f"{api.ACTION_CACHE}/UpdateActionResult"


@pytest.fixture
def client(server: GrpcServer) -> Iterator[Connection]:
    target = f"127.0.0.1:{server.port}"
    connection = Connection(target, target, tls=False, timeout_s=10)
    yield connection
    connection.close()


def write(client: Connection, name: str, *pieces: tuple[int, bytes], finish: bool = True) -> int:
    """Upload pieces that say where they belong."""
    requests = [
        api.WriteRequest(name, place, finish and number == len(pieces), data)
        for number, (place, data) in enumerate(pieces, start=1)
    ]
    return client.write(WRITE, iter(requests), api.WriteResponse, 0).committed_size


def refused(client: Connection, name: str, *pieces: tuple[int, bytes], finish: bool = True) -> str:
    with pytest.raises(CallFault) as caught:
        write(client, name, *pieces, finish=finish)
    return caught.value.status


def files(store: Store) -> set[Path]:
    return {path for path in store.root.rglob("*") if path.is_file()}


def test_a_blob_is_read_in_part(client: Connection, store: Store) -> None:
    data = blob(3 * api.PIECE)
    name = resource.to_read("any/instance", digest_of(data))
    store.blobs.put(data)

    def read(offset: int, limit: int) -> bytes:
        found = client.read(READ, api.ReadRequest(name, offset, limit), api.ReadResponse, 0)
        return b"".join(answer.data for answer in found)

    assert read(0, 0) == data
    assert read(5, 10) == data[5:15]
    assert read(api.PIECE - 1, 2 * api.PIECE) == data[api.PIECE - 1 : 3 * api.PIECE - 1]
    assert read(len(data), 0) == b""
    for offset, limit in ((-1, 0), (len(data) + 1, 0), (0, -1)):
        with pytest.raises(CallFault) as caught:
            read(offset, limit)
        assert caught.value.status == "OUT_OF_RANGE"


def test_the_empty_blob_is_always_there(client: Connection, store: Store) -> None:
    empty = digest_of(b"")
    assert list(client.read(READ, api.ReadRequest(resource.to_read("", empty)), api.ReadResponse, 0)) == []
    answer = client.ask(
        f"{api.CAS}/BatchReadBlobs", api.BatchReadBlobsRequest("", (empty,)), api.BatchReadBlobsResponse
    )
    assert answer.responses == (api.Download(empty),)
    assert write(client, resource.to_write("", empty), (0, b"")) == 0
    message = encode([OutputFile("log", empty.hash, 0)])
    client.ask_bytes(UPDATE, api.UpdateActionResultRequest("", KEY, message))
    assert client.ask_bytes(GET, api.GetActionResultRequest("", KEY)) == message


def test_a_damaged_blob_is_found_while_it_is_given(remote: Reapi, store: Store) -> None:
    small, large = b"small", blob(5 << 20)
    for data in (small, large):
        store.blobs.put(data)
        path = store.blobs.path(digest_of(data).hash)
        path.chmod(0o644)
        path.write_bytes(data[:-1] + b"?")
    came = Blobs()
    remote.fetch([digest_of(small)], came.take)
    assert came == {}
    with pytest.raises(RemoteFault, match="DATA_LOSS"):
        remote.fetch([digest_of(large)], came.take)
    assert remote.missing([digest_of(small), digest_of(large)]) == {digest_of(small), digest_of(large)}


def test_uploads_arrive_whole_or_not_at_all(client: Connection, store: Store) -> None:
    data = blob(1000)
    before = files(store)

    def name(size: int = 1000) -> str:
        return resource.to_write("", Digest(digest_of(data).hash, size))

    assert refused(client, name(), (0, data[:-1] + b"?")) == "INVALID_ARGUMENT"
    assert refused(client, name(), (0, data[:-1])) == "INVALID_ARGUMENT"
    assert refused(client, name(), (0, data + b"?")) == "INVALID_ARGUMENT"
    assert refused(client, name(), (0, data[:10]), (11, data[11:])) == "INVALID_ARGUMENT"
    assert refused(client, name(), (10, data[10:])) == "INVALID_ARGUMENT"
    assert refused(client, name(999), (0, data)) == "INVALID_ARGUMENT"
    assert refused(client, name()) == "INVALID_ARGUMENT"
    assert files(store) == before
    assert write(client, name(), (0, data[:10]), (10, data[10:])) == 1000
    assert store.blobs.get(digest_of(data).hash) == data
    assert write(client, name(), (0, b"")) == 1000  # it is there already
    status = client.ask(
        f"{api.BYTE_STREAM}/QueryWriteStatus", api.QueryWriteStatusRequest(name()), api.QueryWriteStatusResponse
    )
    assert status == api.QueryWriteStatusResponse(1000, True)


@pytest.mark.parametrize(
    "name",
    [
        f"uploads/u/blobs/{'../' * 20}etc/passwd/1",
        f"uploads/u/blobs/..%2f{'a' * 61}/1",
        f"uploads/u/blobs/{'A' * 64}/1",
        f"uploads/u/blobs/{'a' * 64}/99999999999999999999999",
        f"uploads/u/compressed-blobs/zstd/{'a' * 64}/1",
        f"blobs/{'a' * 64}/1",
        "",
        "\0",
    ],
)
def test_names_that_lead_elsewhere_are_refused(client: Connection, store: Store, name: str) -> None:
    before = files(store)
    assert refused(client, name, (0, b"x")) == "INVALID_ARGUMENT"
    assert files(store) == before


def test_digests_that_are_none_are_refused(client: Connection) -> None:
    bad = Digest("../../etc/passwd", 3)
    result = encode([OutputFile("a", "a" * 64, 1)]).replace(b"a" * 64, b"../" * 21 + b"x")
    requests = {
        f"{api.CAS}/FindMissingBlobs": api.FindMissingBlobsRequest("", (bad,)),
        f"{api.CAS}/BatchReadBlobs": api.BatchReadBlobsRequest("", (bad,)),
        GET: api.GetActionResultRequest("", bad),
        UPDATE: api.UpdateActionResultRequest("", KEY, result),
        READ: api.ReadRequest("blobs/../3"),
    }
    for method, request in requests.items():
        with pytest.raises(CallFault) as caught:
            client.ask_bytes(method, request)
        assert caught.value.status == "INVALID_ARGUMENT"
    stored = client.ask(
        f"{api.CAS}/BatchUpdateBlobs",
        api.BatchUpdateBlobsRequest("", (api.Upload(bad, b"abc"), api.Upload(digest_of(b"x"), b"x", compressor=1))),
        api.BatchUpdateBlobsResponse,
    )
    assert [one.status.code for one in stored.responses] == [api.INVALID_ARGUMENT] * 2


@pytest.mark.parametrize("data", [b"\xff", b"\x0a\xff\xff\xff\xff\x07", b"\x12\x01\x80", b"\x0b"])
def test_bytes_that_are_no_message_are_refused(server: GrpcServer, data: bytes) -> None:
    with grpc.insecure_channel(f"127.0.0.1:{server.port}") as channel:
        for method in (f"{api.CAS}/FindMissingBlobs", f"{api.CAS}/BatchUpdateBlobs", GET, UPDATE):
            with pytest.raises(grpc.RpcError) as caught:
                channel.unary_unary(f"/{method}")(data, timeout=10)
            assert caught.value.code() is grpc.StatusCode.INVALID_ARGUMENT


def test_a_batch_that_is_too_long_is_refused(client: Connection) -> None:
    many = tuple(Digest(digest_of(bytes([n])).hash, 1 << 20) for n in range(5))
    with pytest.raises(CallFault, match="a batch may carry") as caught:
        client.ask_bytes(f"{api.CAS}/BatchReadBlobs", api.BatchReadBlobsRequest("", many))
    assert caught.value.status == "INVALID_ARGUMENT"


def test_a_result_is_given_while_all_that_it_names_is_there(client: Connection, store: Store) -> None:
    """A result of another tool: output files, a folder as a `Tree`, and what was printed."""
    contents = [b"file", b"in the folder", b"below it", b"said", b"moaned"]
    file, inside, below, out, err = map(digest_of, contents)
    tree = wire.encode(
        execution.Tree(
            execution.Directory((execution.FileNode("a", inside),)),
            (execution.Directory((execution.FileNode("b", below),)),),
        )
    )
    result = execution.ActionResult(
        (execution.OutputFile("f", file),),
        (execution.OutputDirectory("d", digest_of(tree)),),
        stdout_digest=out,
        stderr_digest=err,
    )
    message = wire.encode(result) + b"\x20\x02"  # a failed action is a result, too
    for lacking in (*contents, tree):
        request = api.UpdateActionResultRequest("", KEY, message)
        with pytest.raises(CallFault, match="blobs come first") as caught:
            client.ask_bytes(UPDATE, request)
        assert caught.value.status == "FAILED_PRECONDITION"
        for data in (*contents, tree):
            store.blobs.put(data)
        client.ask_bytes(UPDATE, request)
        assert client.ask_bytes(GET, api.GetActionResultRequest("", KEY)) == message
        store.blobs.path(digest_of(lacking).hash).unlink()
        with pytest.raises(CallFault) as caught:
            client.ask_bytes(GET, api.GetActionResultRequest("", KEY))
        assert caught.value.status == "NOT_FOUND"


def test_only_the_key_that_an_action_stands_for_leads_to_a_result(client: Connection, store: Store) -> None:
    other = digest_of(b"another key document")
    message = encode([OutputFile("a", digest_of(b"").hash, 0)])
    request = api.UpdateActionResultRequest("", action.of_key(KEY).digest, message)
    client.ask_bytes(UPDATE, request, key=other)
    foreign = store.root / "foreign"
    assert {path.name for path in files(store) if path.is_relative_to(foreign)} == {action.of_key(KEY).digest.hash[2:]}
    client.ask_bytes(UPDATE, request, key=KEY)
    assert (foreign / KEY.hash[:2] / KEY.hash[2:]).read_bytes() == message


def test_what_is_served_to_be_read_cannot_be_written(store: Store) -> None:
    store.blobs.put(b"here")
    before = files(store)
    large = Blobs(blob(5 << 20))
    server = serve_grpc(store, "127.0.0.1", 0, read_only=True)
    with connected(server.port) as remote:
        came = Blobs()
        remote.fetch([digest_of(b"here")], came.take)
        assert came == Blobs(b"here")
        for call in (
            lambda: remote.put_action(KEY, b""),
            lambda: remote.send([digest_of(b"x")], Blobs(b"x").give),
            lambda: remote.send(list(large), large.give),
        ):
            with pytest.raises(RemoteFault, match=r"takes no results|does not allow that") as caught:
                call()
            assert caught.value.refused
    server.stop(0)
    assert files(store) == before


def test_a_full_disk_is_said(client: Connection, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise StoreError("the store is full", code="DXB-S101")

    for way in ("new_file", "write"):
        monkeypatch.setattr(f"dextera_build.store.files.{way}", full)
    assert refused(client, resource.to_write("", digest_of(b"x")), (0, b"x")) == "RESOURCE_EXHAUSTED"
    stored = client.ask(
        f"{api.CAS}/BatchUpdateBlobs",
        api.BatchUpdateBlobsRequest("", (api.Upload(digest_of(b"x"), b"x"),)),
        api.BatchUpdateBlobsResponse,
    )
    assert stored.responses[0].status == api.Status(api.RESOURCE_EXHAUSTED, "the store is full")


def test_two_servers_do_not_share_a_port(store: Store, server: GrpcServer) -> None:
    with pytest.raises(StoreError, match="nothing can listen on") as caught:
        serve_grpc(store, "127.0.0.1", server.port, read_only=False)
    assert caught.value.code == "DXB-S223"


def test_an_upload_that_breaks_off_leaves_nothing(server: GrpcServer, store: Store) -> None:
    data = blob(4 << 20)
    before = files(store)
    with grpc.insecure_channel(f"127.0.0.1:{server.port}") as channel:

        def requests() -> Iterator[bytes]:
            yield wire.encode(api.WriteRequest(resource.to_write("", digest_of(data)), 0, False, data[: 1 << 20]))
            call.cancel()
            yield b""

        call = channel.stream_unary(f"/{WRITE}").future(requests(), timeout=10)
        with pytest.raises((grpc.RpcError, grpc.FutureCancelledError)):
            call.result()
    deadline = time.monotonic() + 20
    while files(store) != before:
        assert time.monotonic() < deadline
        time.sleep(0.05)
