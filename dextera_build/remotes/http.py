"""A Bazel HTTP cache as a remote: results under `/ac/<hex>`, blobs under `/cas/<hex>`, with GET, HEAD and PUT.

nginx with WebDAV, bazel-remote and `dxb cache serve` speak it. Credentials come from the address or from `~/.netrc`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import BinaryIO

import httpx

from dextera_build.remotes.remote import Digest, Kind, Remote, RemoteFault, T, is_loopback

_CHUNK = 1 << 18
_CONNECTIONS = 32
_CONNECT_S = 5.0
_REFUSED = {
    401: "it wants a name and a password",
    403: "it forbids that",
    405: "it does not allow that",
    501: "it cannot do that",
}


def opened(address: str, options: Mapping[str, str], timeout_s: float) -> Remote:
    """Open a server, as `schemes.opened`."""
    return HttpCache(address, timeout_s=timeout_s)


class HttpCache(Remote):
    """One server.

    Args:
        url: `https://user:password@host/prefix?token=...`; user, password and query are used and never shown.
        timeout_s: How long to wait for the next bytes [s].

    Raises:
        ValueError: The address is malformed.
    """

    def __init__(self, url: str, *, timeout_s: float = 10.0) -> None:
        try:
            parsed = httpx.URL(url)
        except httpx.InvalidURL:  # its message quotes the address
            raise ValueError("a password has `/`, `?`, `#`, `@` and `:` as %2F, %3F, %23, %40 and %3A") from None
        shown = parsed.copy_with(username=None, password=None, query=None)
        self.address = str(shown).rstrip("/")
        self._timeout_s = timeout_s
        self._client = httpx.Client(
            auth=(parsed.username, parsed.password) if parsed.username else _netrc(parsed),
            params=parsed.params,
            # A compressed body would not have the size that belongs to its digest.
            headers={"Accept-Encoding": "identity"},
            timeout=httpx.Timeout(timeout_s, connect=min(_CONNECT_S, timeout_s), pool=None),
            limits=httpx.Limits(max_connections=_CONNECTIONS, max_keepalive_connections=_CONNECTIONS),
            follow_redirects=True,
        )

    def has(self, digest: Digest) -> bool:
        """As `Remote`."""
        with self._faults():
            answer = self._client.head(self._url("cas", digest.hash))
        if answer.status_code == 404 or answer.headers.get("Content-Length", str(digest.size)) != str(digest.size):
            return False
        self._expect(answer, 200, 204)
        return True

    def close(self) -> None:
        """As `Remote`."""
        self._client.close()

    def _get(self, kind: Kind, name: str, take: Callable[[Iterator[bytes]], T]) -> T | None:
        with self._faults(), self._client.stream("GET", self._url(kind, name)) as answer:
            if answer.status_code == 404:
                return None
            self._expect(answer, 200)
            # Not decoded, so no body expands to more bytes than were sent.
            return take(answer.iter_raw(_CHUNK))

    def _put(self, kind: Kind, digest: Digest, file: BinaryIO) -> None:
        url, content = self._url(kind, digest.hash), iter(lambda: file.read(_CHUNK), b"")
        # With a length, the body is not sent in chunks, which some servers reject.
        headers = {"Content-Length": str(digest.size)}
        with self._faults(), self._client.stream("PUT", url, content=content, headers=headers) as answer:
            self._expect(answer, 200, 201, 202, 204)
            said = 0
            for piece in answer.iter_raw(_CHUNK):  # to the end, so that the connection can be reused
                said += len(piece)
                if said > _CHUNK:
                    break

    def _url(self, kind: str, digest: str) -> str:
        return f"{self.address}/{kind}/{digest}"

    def _expect(self, answer: httpx.Response, *codes: int) -> None:
        code = answer.status_code
        if code in codes:
            return
        reason = _REFUSED.get(code, answer.reason_phrase)
        verb = answer.request.method
        raise RemoteFault(self.address, f"{verb} was answered {code}: {reason}", refused=code in _REFUSED)

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except httpx.ConnectTimeout:
            raise RemoteFault(self.address, "no connection in time") from None
        except httpx.TimeoutException:
            raise RemoteFault(self.address, f"no answer in {self._timeout_s:g} s") from None
        except httpx.ConnectError as error:
            raise RemoteFault(self.address, f"no connection: {_plain(error)}") from None
        except (httpx.HTTPError, httpx.StreamError, httpx.InvalidURL, RuntimeError, OSError) as error:
            # RuntimeError: the client was closed by another thread, which gave this remote up.
            raise RemoteFault(self.address, f"the connection broke: {_plain(error)}") from None


def _plain(error: Exception) -> str:
    said = str(error).partition("\n")[0]
    return re.sub(r"^\[Errno -?\d+\] ", "", said) or type(error).__name__


def _netrc(url: httpx.URL) -> httpx.NetRCAuth | None:
    if url.scheme != "https" and not is_loopback(url.host):
        return None  # credentials need TLS
    try:
        return httpx.NetRCAuth(os.environ.get("NETRC"))
    except (OSError, SyntaxError):
        return None
