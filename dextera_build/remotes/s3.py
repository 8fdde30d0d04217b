"""An object store as a remote: S3 and compatible services, Google Cloud Storage, Azure Blob Storage.

Objects have the names of a Bazel HTTP cache, `ac/<hex>` and `cas/<hex>`, so a bucket that is served over HTTP works
with other tools, too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from typing import Any, BinaryIO

import obstore
from obstore import exceptions
from obstore.store import from_url

from dextera_build.remotes.remote import Digest, Kind, Remote, RemoteFault, T

_CHUNK = 1 << 20
_PART = 8 << 20
_METADATA = "169.254.169.254"
"""Metadata server of cloud machines, the last source of credentials."""
_REQUEST = re.compile(r"^(Generic \w+ error: )?(Error performing \w+ \S+ in [\d.]+\w+(, after \d+ retries.*?)? +- )?")
_CAUSE = re.compile(r'(?:message|error): "([^"]+)"')
_REFUSALS = (exceptions.PermissionDeniedError, exceptions.UnauthenticatedError, exceptions.NotSupportedError)
_CLIENT = re.compile("allow_|connect_timeout|default_content_type|http[12]_|pool_|proxy_|timeout|user_agent")
"""Name prefixes of obstore's connection options."""


def opened(address: str, options: Mapping[str, str], timeout_s: float) -> Remote:
    """Open a bucket, as `schemes.opened`."""
    return ObjectStore(address, options, timeout_s=timeout_s)


class ObjectStore(Remote):
    """One bucket, or one prefix of it.

    Args:
        url: `s3://bucket/prefix`, `gs://bucket/prefix` or `az://container/prefix`.
        options: obstore's configuration: `endpoint`, `region`, ...; environment variables (`AWS_ACCESS_KEY_ID`, ...)
            apply, too.
        timeout_s: How long to wait for an answer [s].

    Raises:
        ValueError: The address or an option is invalid.
    """

    def __init__(self, url: str, options: Mapping[str, str] | None = None, *, timeout_s: float = 10.0) -> None:
        self.address = url.rstrip("/")
        patience = timedelta(seconds=timeout_s)
        said = options or {}
        # As settings of the bucket, connection options make the library panic.
        config: Any = {name: value for name, value in said.items() if not _CLIENT.match(name)}
        # The library must not retry ten times on its own: a build retries once, or continues without the remote.
        retry: Any = {"max_retries": 1, "retry_timeout": patience}
        client: Any = {"timeout": f"{max(timeout_s * 6, 60.0):g}s", "connect_timeout": f"{min(timeout_s, 5.0):g}s"}
        client |= {name: value for name, value in said.items() if _CLIENT.match(name)}
        # `refuse_clear` ensured that credentials go over TLS or to this machine.
        client["allow_http"] = any(value.startswith("http://") for name, value in config.items() if "endpoint" in name)
        try:
            self._store = from_url(self.address, config=config, client_options=client, retry_config=retry)
        except exceptions.BaseError as error:
            raise ValueError(str(error)) from None

    def has(self, digest: Digest) -> bool:
        """As `Remote`."""
        with self._faults():
            try:
                return int(obstore.head(self._store, f"cas/{digest.hash}")["size"]) == digest.size
            except FileNotFoundError:
                return False

    def _get(self, kind: Kind, name: str, take: Callable[[Iterator[bytes]], T]) -> T | None:
        with self._faults():
            try:
                found = obstore.get(self._store, f"{kind}/{name}")
            except FileNotFoundError:
                return None
            return take(map(bytes, found.stream(min_chunk_size=_CHUNK)))

    def _put(self, kind: Kind, digest: Digest, file: BinaryIO) -> None:
        with self._faults():
            obstore.put(self._store, f"{kind}/{digest.hash}", file, chunk_size=_PART, max_concurrency=4)

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except RemoteFault:
            raise
        except _REFUSALS as error:
            raise RemoteFault(self.address, f"it refuses: {_plain(error)}", refused=True) from None
        except exceptions.BaseError as error:
            raise RemoteFault(self.address, _plain(error)) from None
        except OSError as error:
            raise RemoteFault(self.address, _plain(error), refused=isinstance(error, PermissionError)) from None


def _plain(error: Exception) -> str:
    """The library's message in one line, without the address of the request, which may contain a signature."""
    text, _, more = str(error).partition("\n")
    if _METADATA in text:
        return "there are no credentials for it: set `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY`"
    text = _REQUEST.sub("", text).partition(" (http")[0]
    if causes := _CAUSE.findall(more):
        text += f": {causes[-1]}"
    return text[:200] or type(error).__name__
