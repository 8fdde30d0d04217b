"""A server of the Remote Execution API as a remote: bazel-remote, Buildbarn, BuildGrid, Buildfarm, `dxb cache serve`.

Small blobs travel in batches, large ones as streams of pieces, several at once. A key is asked for by the digest of the
`Action` that stands for it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import BinaryIO, TypeAlias
from urllib.parse import unquote

from dextera_build.store.remotes import action, resource
from dextera_build.store.remotes import protocol as api
from dextera_build.store.remotes.channel import CallFault, Connection
from dextera_build.store.remotes.crew import Crew
from dextera_build.store.remotes.remote import Digest, RemoteFault

Take: TypeAlias = Callable[[Digest, Iterator[bytes]], None]
Give: TypeAlias = Callable[[Digest], BinaryIO]

_THREADS = 4
_ASKED = 10_000  # digests in one question, about 750 KiB
_MOST = 500  # blobs in one batch
_EACH = 128  # bytes that a blob's digest and status take in a batch
_BREAKS = 3
_AGAIN = {"UNAVAILABLE", "ABORTED", "INTERNAL", "UNKNOWN"}
"""What a connection that broke looks like; a stream goes on from where it was."""


class Reapi:
    """A remote that speaks the Remote Execution API, version 2, over gRPC.

    Args:
        address: `host:port`; `token@host:port` or `user:password@host:port` where the server asks who comes.
        instance: Name of the server's instance; many servers have one without a name.
        tls: Whether the connection is encrypted.
        timeout_s: How long an answer, or the next piece of one, may take [s].

    Raises:
        StoreError: The environment asks for what cannot be done.
    """

    def __init__(self, address: str, instance: str, *, tls: bool, timeout_s: float) -> None:
        secret, _, target = address.rpartition("@")
        self.address = "/".join([f"grpc{'s' * tls}://{target}", *([instance] if instance else [])])
        self._instance = instance
        self._connection = Connection(target, self.address, unquote(secret), tls=tls, timeout_s=timeout_s)
        self._crew = Crew(_THREADS, f"dxb {target}")
        self._capable = threading.Lock()
        self._capabilities: api.CacheCapabilities | None = None

    def get_action(self, key: Digest) -> bytes | None:
        """The `ActionResult` message under a key, or None."""
        self._limits()
        request = api.GetActionResultRequest(self._instance, action.of_key(key).digest)
        try:
            return self._connection.ask_bytes(f"{api.ACTION_CACHE}/GetActionResult", request, key)
        except CallFault as fault:
            if fault.status == "NOT_FOUND":
                return None
            raise

    def put_action(self, key: Digest, message: bytes) -> None:
        """Publish a result, all of whose blobs the server holds."""
        if not self._limits().action_cache_update.update_enabled:
            raise RemoteFault(self.address, "it takes no results", refused=True)
        standing = action.of_key(key)
        self._update([api.Upload(digest, data) for digest, data in standing.blobs.items()])
        request = api.UpdateActionResultRequest(self._instance, standing.digest, message)
        self._connection.ask_bytes(f"{api.ACTION_CACHE}/UpdateActionResult", request, key)

    def missing(self, digests: Sequence[Digest]) -> set[Digest]:
        """Those that the server lacks."""
        self._limits()
        asked = list(dict.fromkeys(digests))
        lacking: set[Digest] = set()

        def ask(part: list[Digest]) -> None:
            request = api.FindMissingBlobsRequest(self._instance, tuple(part))
            method = f"{api.CAS}/FindMissingBlobs"
            lacking.update(self._connection.ask(method, request, api.FindMissingBlobsResponse).missing_blob_digests)

        self._crew.each(ask, [asked[place : place + _ASKED] for place in range(0, len(asked), _ASKED)])
        return lacking.intersection(asked)

    def fetch(self, digests: Sequence[Digest], take: Take) -> None:
        """Hand `take` the bytes of every blob that the server holds."""
        for digest in dict.fromkeys(digests):
            if not digest.size:  # nothing is nowhere missing
                take(digest, iter(()))

        def work(part: list[Digest]) -> None:
            if self._fits(part[0]):
                self._fetch_batch(part, take)
            else:
                self._fetch_stream(part[0], take)

        self._crew.each(work, self._parts([digest for digest in digests if digest.size]))

    def send(self, digests: Sequence[Digest], give: Give) -> None:
        """Upload blobs."""

        def work(part: list[Digest]) -> None:
            if self._fits(part[0]):
                self._send_batch(part, give)
            else:
                self._send_stream(part[0], give)

        self._crew.each(work, self._parts(digests))

    def close(self) -> None:
        """Let the connection and the threads go."""
        self._connection.close()
        self._crew.dismiss()

    def _limits(self) -> api.CacheCapabilities:
        with self._capable:
            if self._capabilities is None:
                request = api.GetCapabilitiesRequest(self._instance)
                method = f"{api.CAPABILITIES}/GetCapabilities"
                self._capabilities = self._check(self._connection.ask(method, request, api.ServerCapabilities))
            return self._capabilities

    def _check(self, found: api.ServerCapabilities) -> api.CacheCapabilities:
        if found.low_api_version.major > 2 or 0 < found.high_api_version.major < 2:
            raise RemoteFault(self.address, "it does not speak version 2 of the API", refused=True)
        if api.SHA256 not in found.cache.digest_functions:
            raise RemoteFault(self.address, "it keeps no blobs by SHA-256", refused=True)
        return found.cache

    def _batch(self) -> int:
        """How much one batch may carry [bytes]; never more than one message by default, whatever the server allows."""
        limit = self._limits().max_batch_total_size_bytes
        return min(limit, api.BATCH) if limit > 0 else api.BATCH

    def _fits(self, digest: Digest) -> bool:
        return digest.size + _EACH <= self._batch()

    def _parts(self, digests: Sequence[Digest]) -> list[list[Digest]]:
        """Large blobs each alone and first, for they take longest; the others in batches."""
        if not digests:
            return []
        limit, batches, room = self._batch(), list[list[Digest]](), 0
        each = dict.fromkeys(digests)
        for digest in filter(self._fits, each):
            room -= digest.size + _EACH
            if room < 0 or len(batches[-1]) == _MOST:
                batches.append([])
                room = limit - digest.size - _EACH
            batches[-1].append(digest)
        return [[digest] for digest in each if not self._fits(digest)] + batches

    def _fetch_batch(self, digests: list[Digest], take: Take) -> None:
        request = api.BatchReadBlobsRequest(self._instance, tuple(digests))
        answer = self._connection.ask(f"{api.CAS}/BatchReadBlobs", request, api.BatchReadBlobsResponse)
        asked = set(digests)
        for found in answer.responses:
            if found.status.code == api.NOT_FOUND or found.digest not in asked:
                continue
            self._expect(found.digest, found.status)
            if found.compressor:
                raise RemoteFault(self.address, "it compresses what was not to be compressed")
            asked.remove(found.digest)
            take(found.digest, iter((found.data,)))

    def _fetch_stream(self, digest: Digest, take: Take) -> None:
        pieces = self._read(digest)
        try:
            # Whether the server has it is known with the first piece.
            first = next(pieces)
        except StopIteration:
            first = b""
        except CallFault as fault:
            if fault.status == "NOT_FOUND":
                return
            raise
        take(digest, _after(first, pieces))
        pieces.close()

    def _read(self, digest: Digest) -> Generator[bytes, None, None]:
        done, breaks = 0, 0
        while True:
            request = api.ReadRequest(resource.to_read(self._instance, digest), done)
            before = done
            stream = self._connection.read(f"{api.BYTE_STREAM}/Read", request, api.ReadResponse, digest.size - done)
            try:
                for answer in stream:
                    done += len(answer.data)
                    if done > digest.size:
                        raise RemoteFault(self.address, f"blob `{digest.hash[:12]}` does not end")
                    yield answer.data
            except CallFault as fault:
                breaks += 1
                if fault.status not in _AGAIN or breaks > _BREAKS or done == before:
                    raise
            else:
                return
            finally:
                stream.close()

    def _send_batch(self, digests: list[Digest], give: Give) -> None:
        uploads = []
        for digest in digests:
            with give(digest) as file:
                uploads.append(api.Upload(digest, file.read(digest.size + 1)))
        self._update(uploads)

    def _update(self, uploads: list[api.Upload]) -> None:
        request = api.BatchUpdateBlobsRequest(self._instance, tuple(uploads))
        answer = self._connection.ask(f"{api.CAS}/BatchUpdateBlobs", request, api.BatchUpdateBlobsResponse)
        for stored in answer.responses:
            self._expect(stored.digest, stored.status)
        lost = {upload.digest for upload in uploads}.difference(stored.digest for stored in answer.responses)
        if lost:
            raise RemoteFault(self.address, f"it does not say what became of blob `{min(lost).hash[:12]}`")

    def _send_stream(self, digest: Digest, give: Give) -> None:
        name, offset = resource.to_write(self._instance, digest), 0
        for breaks in range(_BREAKS + 1):
            try:
                with give(digest) as file:
                    file.seek(offset)
                    committed = self._write(name, digest, file, offset)
            except CallFault as fault:
                if fault.status not in _AGAIN or breaks == _BREAKS:
                    raise
                committed = self._committed(name)
            # All of it is there, too, where somebody else brought it meanwhile.
            if committed == digest.size:
                return
            offset = committed if 0 < committed < digest.size else 0
        raise RemoteFault(
            self.address, f"it took {committed:,} bytes of blob `{digest.hash[:12]}`, not {digest.size:,}"
        )

    def _write(self, name: str, digest: Digest, file: BinaryIO, offset: int) -> int:
        errors: list[Exception] = []

        def pieces() -> Iterator[api.WriteRequest]:
            place = offset
            try:
                while place < digest.size:
                    data = file.read(min(api.PIECE, digest.size - place))
                    end = place + len(data)
                    yield api.WriteRequest(name, place, end == digest.size or not data, data)
                    if not data:
                        return
                    place = end
            except Exception as error:  # in a thread of gRPC, which would print it
                errors.append(error)

        method = f"{api.BYTE_STREAM}/Write"
        try:
            committed = self._connection.write(method, pieces(), api.WriteResponse, digest.size - offset).committed_size
        except RemoteFault:
            # A file that could not be read breaks the call; it is closed only after that.
            if errors:
                raise errors[0] from None
            raise
        return committed

    def _committed(self, name: str) -> int:
        """How much of an upload that broke has arrived [bytes]."""
        request = api.QueryWriteStatusRequest(name)
        try:
            found = self._connection.ask(f"{api.BYTE_STREAM}/QueryWriteStatus", request, api.QueryWriteStatusResponse)
        except CallFault as fault:
            if fault.status in {"NOT_FOUND", "UNIMPLEMENTED", "INVALID_ARGUMENT"}:
                return 0
            raise
        return found.committed_size

    def _expect(self, digest: Digest, status: api.Status) -> None:
        if status.code != api.OK:
            said = f": {' '.join(status.message.split())[:200]}" if status.message else ""
            raise RemoteFault(
                self.address,
                f"blob `{digest.hash[:12]}` was answered with status {status.code}{said}",
                refused=status.code == api.PERMISSION_DENIED,
            )


def _after(first: bytes, rest: Iterator[bytes]) -> Iterator[bytes]:
    yield first
    yield from rest
