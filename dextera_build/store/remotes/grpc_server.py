"""A store as a server of the Remote Execution API: what Bazel, BuildGrid's clients and other copies of dxb can share.

Results of other tools lie beside ours; each is handed out only while every blob that it names is there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from dextera_build.errors import MachineError, StoreError
from dextera_build.store import wire
from dextera_build.store.cas import MissingBlob, is_digest
from dextera_build.store.remotes import action, resource
from dextera_build.store.remotes import protocol as api
from dextera_build.store.remotes.offers import Offers
from dextera_build.store.remotes.remote import MOST_ENTRY, Digest
from dextera_build.store.store import Store

T = TypeVar("T")

_THREADS = 16
_EMPTY = action.of_bytes(b"")
_FULL = "DXB-S101"


class GrpcServer:
    """A server that runs in threads of this process.

    Args:
        server: The server of grpcio.
        host: Where it listens.
        port: Where it listens.
    """

    def __init__(self, server: Any, host: str, port: int) -> None:
        self._server = server
        self.port = port
        self.url = f"grpc://[{host}]:{port}" if ":" in host else f"grpc://{host}:{port}"
        """Where clients find it."""

    def wait(self) -> None:
        """Return when the server was stopped."""
        self._server.wait_for_termination()

    def stop(self, grace_s: float = 1.0) -> None:
        """Take no more calls, and end those under way after `grace_s` [s]."""
        self._server.stop(grace_s).wait()


def serve_grpc(store: Store, host: str, port: int, *, read_only: bool) -> GrpcServer:
    """Start a server.

    Args:
        store: What it serves.
        host: Address to listen on.
        port: Port to listen on; 0 takes a free one.
        read_only: Whether clients may only read.

    Raises:
        MachineError: grpcio is not installed.
        StoreError: Nothing can listen there.
    """
    grpc = _library()
    options = [("grpc.so_reuseport", 0), ("grpc.max_receive_message_length", MOST_ENTRY + (1 << 20))]
    server = grpc.server(ThreadPoolExecutor(_THREADS, "dxb serve"), options=options)
    server.add_generic_rpc_handlers(_handlers(grpc, _Service(store, grpc.StatusCode, read_only=read_only)))
    place = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    try:
        bound = server.add_insecure_port(place)
    except RuntimeError:
        bound = 0
    if not bound:
        raise StoreError(
            f"nothing can listen on `{place}`",
            code="DXB-S223",
            hint="another program listens there, or it is no address of this machine: choose another `--grpc` port",
        )
    server.start()
    return GrpcServer(server, host, bound)


def _library() -> Any:
    try:
        import grpc
    except ImportError:
        raise MachineError(
            "a server for gRPC needs grpcio, which is not installed",
            code="DXB-E336",
            hint="pip install 'dextera-build[share]'",
        ) from None
    return grpc


class _Refusal(Exception):  # noqa: N818 - an answer, not an error of ours
    """How a call ends that cannot be served."""

    def __init__(self, status: str, message: str) -> None:
        super().__init__(message)
        self.status = status


class _Service:
    """The calls; each takes a message and the context of its call."""

    def __init__(self, store: Store, statuses: Any, *, read_only: bool) -> None:
        self._blobs = store.blobs
        self._offers = Offers(store)
        self._statuses = statuses
        self._read_only = read_only

    @contextmanager
    def answers(self, context: Any) -> Iterator[None]:
        """Turn what goes wrong in the block into a status."""
        try:
            yield
        except _Refusal as refusal:
            context.abort(self._statuses[refusal.status], str(refusal))
        except ValueError as error:
            context.abort(self._statuses.INVALID_ARGUMENT, str(error))
        except MissingBlob as error:
            context.abort(self._statuses.NOT_FOUND, error.message)
        except StoreError as error:
            status = self._statuses.RESOURCE_EXHAUSTED if error.code == _FULL else self._statuses.INTERNAL
            context.abort(status, error.message)

    def capabilities(self, request: api.GetCapabilitiesRequest, context: Any) -> api.ServerCapabilities:
        update = api.UpdateCapabilities(not self._read_only)
        cache = api.CacheCapabilities((api.SHA256,), update, api.BATCH)
        return api.ServerCapabilities(cache, api.SemVer(2, 0), api.SemVer(2, 3))

    def find_missing(self, request: api.FindMissingBlobsRequest, context: Any) -> api.FindMissingBlobsResponse:
        return api.FindMissingBlobsResponse(tuple(d for d in request.blob_digests if not self._has(d)))

    def update(self, request: api.BatchUpdateBlobsRequest, context: Any) -> api.BatchUpdateBlobsResponse:
        self._writing()
        return api.BatchUpdateBlobsResponse(
            tuple(api.Stored(upload.digest, self._take(upload)) for upload in request.requests)
        )

    def batch_read(self, request: api.BatchReadBlobsRequest, context: Any) -> api.BatchReadBlobsResponse:
        if sum(max(digest.size, 0) for digest in request.digests) > api.BATCH:
            raise ValueError(f"a batch may carry {api.BATCH} bytes")
        return api.BatchReadBlobsResponse(tuple(map(self._give, request.digests)))

    def read(self, request: api.ReadRequest, context: Any) -> Iterator[api.ReadResponse]:
        digest, start = resource.read_from(request.resource_name), request.read_offset
        if not self._has(digest):
            raise MissingBlob(digest.hash)
        if not 0 <= start <= digest.size or request.read_limit < 0:
            raise _Refusal("OUT_OF_RANGE", f"the blob has {digest.size} bytes")
        left = min(request.read_limit or digest.size, digest.size - start)
        if left:
            yield from map(api.ReadResponse, self._pieces(digest, start, left))

    def write(self, requests: Iterator[bytes], context: Any) -> api.WriteResponse:
        self._writing()
        first = wire.decode(api.WriteRequest, next(requests, b""))
        digest = resource.written_to(first.resource_name)
        if not self._has(digest) and not self._blobs.receive(*digest, _data(first, requests)):
            raise ValueError(f"what was uploaded is not blob {digest.hash} with {digest.size} bytes")
        return api.WriteResponse(digest.size)

    def write_status(self, request: api.QueryWriteStatusRequest, context: Any) -> api.QueryWriteStatusResponse:
        digest = resource.written_to(request.resource_name)
        # What broke off begins anew: half a blob is never kept.
        return api.QueryWriteStatusResponse(digest.size, True) if self._has(digest) else api.QueryWriteStatusResponse()

    def get_action(self, request: api.GetActionResultRequest, context: Any) -> bytes:
        message = self._offers.get(self._key(request.action_digest, context))
        if message is None:
            raise _Refusal("NOT_FOUND", "there is no such result, or not all that it names")
        return message

    def update_action(self, request: api.UpdateActionResultRequest, context: Any) -> bytes:
        self._writing()
        problem = self._offers.put(self._key(request.action_digest, context), request.action_result)
        if problem:
            raise _Refusal("FAILED_PRECONDITION" if "blobs come first" in problem else "INVALID_ARGUMENT", problem)
        return request.action_result

    def _key(self, digest: Digest, context: Any) -> str:
        if not is_digest(digest.hash):
            raise ValueError("not a SHA-256 digest")
        header = dict(context.invocation_metadata()).get(action.METADATA, b"")
        key = action.key_in(header, digest)
        return key.hash if key else digest.hash

    def _writing(self) -> None:
        if self._read_only:
            raise _Refusal("PERMISSION_DENIED", "this store is served to be read only")

    def _has(self, digest: Digest) -> bool:
        if not is_digest(digest.hash):
            raise ValueError("not a SHA-256 digest")
        return self._blobs.size(digest.hash) == digest.size or digest == _EMPTY

    def _take(self, upload: api.Upload) -> api.Status:
        digest, data = upload.digest, upload.data
        if upload.compressor or digest != action.of_bytes(data):
            return api.Status(api.INVALID_ARGUMENT, "the bytes are not those that the digest names")
        try:
            self._blobs.put(data)
        except StoreError as error:
            return api.Status(api.RESOURCE_EXHAUSTED if error.code == _FULL else api.INTERNAL, error.message)
        return api.Status()

    def _give(self, digest: Digest) -> api.Download:
        try:
            if self._has(digest):
                return api.Download(digest, self._blobs.get(digest.hash) if digest.size else b"")
        except MissingBlob:
            pass
        return api.Download(digest, status=api.Status(api.NOT_FOUND, "the blob is not there"))

    def _pieces(self, digest: Digest, start: int, left: int) -> Iterator[bytes]:
        known = hashlib.sha256() if left == digest.size else None
        with self._blobs.open(digest.hash) as file:
            file.seek(start)
            while left and (piece := file.read(min(api.PIECE, left))):
                left -= len(piece)
                if known is not None:
                    known.update(piece)
                yield piece
        if known is not None and known.hexdigest() != digest.hash:
            self._blobs.quarantine(digest.hash)
            raise _Refusal("DATA_LOSS", "the blob was damaged; it was set aside")


def _data(first: api.WriteRequest, requests: Iterable[bytes]) -> Iterator[bytes]:
    """The bytes of an upload; it begins at 0 and leaves no gap."""
    place, request = 0, first
    rest = iter(requests)
    while True:
        if request.write_offset != place:
            raise ValueError(f"byte {place} comes next, not {request.write_offset}")
        yield request.data
        place += len(request.data)
        if request.finish_write:
            return
        data = next(rest, None)
        if data is None:
            return
        request = wire.decode(api.WriteRequest, data)


def _handlers(grpc: Any, service: _Service) -> list[Any]:
    def unary(kind: type[T], work: Callable[[T, Any], object]) -> Any:
        def answer(data: bytes, context: Any) -> bytes:
            with service.answers(context):
                found = work(wire.decode(kind, data), context)
                return found if isinstance(found, bytes) else wire.encode(found)
            raise AssertionError("an aborted call raises")

        return grpc.unary_unary_rpc_method_handler(answer)

    def read(data: bytes, context: Any) -> Iterator[bytes]:
        with service.answers(context):
            yield from map(wire.encode, service.read(wire.decode(api.ReadRequest, data), context))

    def write(requests: Iterator[bytes], context: Any) -> bytes:
        with service.answers(context):
            return wire.encode(service.write(requests, context))
        raise AssertionError("an aborted call raises")

    methods = {
        api.CAPABILITIES: {"GetCapabilities": unary(api.GetCapabilitiesRequest, service.capabilities)},
        api.ACTION_CACHE: {
            "GetActionResult": unary(api.GetActionResultRequest, service.get_action),
            "UpdateActionResult": unary(api.UpdateActionResultRequest, service.update_action),
        },
        api.CAS: {
            "FindMissingBlobs": unary(api.FindMissingBlobsRequest, service.find_missing),
            "BatchUpdateBlobs": unary(api.BatchUpdateBlobsRequest, service.update),
            "BatchReadBlobs": unary(api.BatchReadBlobsRequest, service.batch_read),
        },
        api.BYTE_STREAM: {
            "Read": grpc.unary_stream_rpc_method_handler(read),
            "Write": grpc.stream_unary_rpc_method_handler(write),
            "QueryWriteStatus": unary(api.QueryWriteStatusRequest, service.write_status),
        },
    }
    return [grpc.method_handlers_generic_handler(name, calls) for name, calls in methods.items()]
