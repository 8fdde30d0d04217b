"""Messages of the Remote Execution API, version 2, that a cache needs: `remote_execution.proto`, `bytestream.proto`.

The numbers are those of the published files; fields that neither side of a cache needs are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from dextera_build.store.remotes.remote import Digest

EXECUTION = "build.bazel.remote.execution.v2"
CAPABILITIES = f"{EXECUTION}.Capabilities"
ACTION_CACHE = f"{EXECUTION}.ActionCache"
CAS = f"{EXECUTION}.ContentAddressableStorage"
BYTE_STREAM = "google.bytestream.ByteStream"

SHA256 = 1
"""`DigestFunction.SHA256`."""
OK, INVALID_ARGUMENT, NOT_FOUND, PERMISSION_DENIED, RESOURCE_EXHAUSTED, INTERNAL = 0, 3, 5, 7, 8, 13
"""Codes of `google.rpc.Status`."""
PIECE = 1 << 20
"""How much of a blob one message of a stream carries [bytes]."""
BATCH = (4 << 20) - (64 << 10)
"""How much a batch may carry where a server names no limit: one gRPC message, with room for the rest [bytes]."""


@dataclass(frozen=True)
class SemVer:
    """A version of the API."""

    major: Annotated[int, 1] = 0
    minor: Annotated[int, 2] = 0


@dataclass(frozen=True)
class UpdateCapabilities:
    """`ActionCacheUpdateCapabilities`."""

    update_enabled: Annotated[bool, 1] = False


@dataclass(frozen=True)
class CacheCapabilities:
    """What a server keeps."""

    digest_functions: Annotated[tuple[int, ...], 1] = ()
    action_cache_update: Annotated[UpdateCapabilities, 2] = UpdateCapabilities()
    max_batch_total_size_bytes: Annotated[int, 4] = 0


@dataclass(frozen=True)
class ServerCapabilities:
    """What a server can do."""

    cache: Annotated[CacheCapabilities, 1] = CacheCapabilities()
    low_api_version: Annotated[SemVer, 4] = SemVer()
    high_api_version: Annotated[SemVer, 5] = SemVer()


@dataclass(frozen=True)
class GetCapabilitiesRequest:
    """Ask what a server can do."""

    instance_name: Annotated[str, 1] = ""


@dataclass(frozen=True)
class GetActionResultRequest:
    """Ask for a result; the answer is an `ActionResult`."""

    instance_name: Annotated[str, 1]
    action_digest: Annotated[Digest, 2]


@dataclass(frozen=True)
class UpdateActionResultRequest:
    """Publish a result; the answer is the `ActionResult` again."""

    instance_name: Annotated[str, 1]
    action_digest: Annotated[Digest, 2]
    action_result: Annotated[bytes, 3]


@dataclass(frozen=True)
class FindMissingBlobsRequest:
    """Ask which blobs a server lacks."""

    instance_name: Annotated[str, 1]
    blob_digests: Annotated[tuple[Digest, ...], 2]


@dataclass(frozen=True)
class FindMissingBlobsResponse:
    """Those that it lacks."""

    missing_blob_digests: Annotated[tuple[Digest, ...], 2] = ()


@dataclass(frozen=True)
class Status:
    """`google.rpc.Status`: how one part of a call ended."""

    code: Annotated[int, 1] = OK
    message: Annotated[str, 2] = ""


@dataclass(frozen=True)
class Upload:
    """`BatchUpdateBlobsRequest.Request`."""

    digest: Annotated[Digest, 1]
    data: Annotated[bytes, 2]
    compressor: Annotated[int, 3] = 0


@dataclass(frozen=True)
class BatchUpdateBlobsRequest:
    """Store several small blobs."""

    instance_name: Annotated[str, 1]
    requests: Annotated[tuple[Upload, ...], 2]


@dataclass(frozen=True)
class Stored:
    """`BatchUpdateBlobsResponse.Response`."""

    digest: Annotated[Digest, 1]
    status: Annotated[Status, 2] = Status()


@dataclass(frozen=True)
class BatchUpdateBlobsResponse:
    """How each went."""

    responses: Annotated[tuple[Stored, ...], 1] = ()


@dataclass(frozen=True)
class BatchReadBlobsRequest:
    """Ask for several small blobs."""

    instance_name: Annotated[str, 1]
    digests: Annotated[tuple[Digest, ...], 2]


@dataclass(frozen=True)
class Download:
    """`BatchReadBlobsResponse.Response`."""

    digest: Annotated[Digest, 1]
    data: Annotated[bytes, 2] = b""
    status: Annotated[Status, 3] = Status()
    compressor: Annotated[int, 4] = 0


@dataclass(frozen=True)
class BatchReadBlobsResponse:
    """The blobs."""

    responses: Annotated[tuple[Download, ...], 1] = ()


@dataclass(frozen=True)
class ReadRequest:
    """Ask for a blob in pieces."""

    resource_name: Annotated[str, 1]
    read_offset: Annotated[int, 2] = 0
    read_limit: Annotated[int, 3] = 0


@dataclass(frozen=True)
class ReadResponse:
    """One piece."""

    data: Annotated[bytes, 10] = b""


@dataclass(frozen=True)
class WriteRequest:
    """One piece of a blob to store; only the first needs the name."""

    resource_name: Annotated[str, 1]
    write_offset: Annotated[int, 2]
    finish_write: Annotated[bool, 3]
    data: Annotated[bytes, 10]


@dataclass(frozen=True)
class WriteResponse:
    """How much the server holds; all of it where somebody else brought the blob meanwhile."""

    committed_size: Annotated[int, 1] = 0


@dataclass(frozen=True)
class QueryWriteStatusRequest:
    """Ask how much of an upload arrived."""

    resource_name: Annotated[str, 1]


@dataclass(frozen=True)
class QueryWriteStatusResponse:
    """How much of it the server holds."""

    committed_size: Annotated[int, 1] = 0
    complete: Annotated[bool, 2] = False
