"""One connection to a registry: requests, logging in when it asks for that, and what its answers mean for people."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from dextera_build.errors import MachineError
from dextera_build.store.bundle.registry_login import Login

if TYPE_CHECKING:
    import httpx

_HERE = re.compile(r"(localhost|127(\.\d+){3}|\[::1\])(:\d+)?")
_MOST_ANSWER = 1 << 20


class RegistryError(MachineError):
    """A registry cannot be reached, or refused."""


class Connection:
    """Requests to one repository.

    Args:
        host: `ghcr.io`, `localhost:5000`; spoken to by plain HTTP where it is this machine.
        name: The repository.

    Raises:
        MachineError: The package for HTTP is not installed.
    """

    def __init__(self, host: str, name: str) -> None:
        httpx = _package()
        self._host = host
        scheme = "http" if _HERE.fullmatch(host) else "https"
        self._base = f"{scheme}://{host}/v2/{name}/"
        self._scope = f"repository:{name}:pull,push"
        self._http = httpx.Client(
            timeout=httpx.Timeout(60.0, connect=10.0), transport=httpx.HTTPTransport(retries=2), trust_env=True
        )
        self._login = Login(self._http, host)
        self._header = ""

    def ask(
        self, verb: str, path: str, data: bytes | None = None, headers: Mapping[str, str] | None = None
    ) -> httpx.Response:
        """One request with its whole answer, which is short.

        Raises:
            RegistryError: There is no answer.
        """
        with self.stream(verb, path, headers, data) as answer:
            size = 0
            held = []
            for chunk in answer.iter_raw(1 << 16):
                size += len(chunk)
                if size > _MOST_ANSWER:
                    break
                held.append(chunk)
            answer._content = b"".join(held)
        return answer

    @contextmanager
    def stream(
        self, verb: str, path: str, headers: Mapping[str, str] | None = None, data: bytes | None = None
    ) -> Iterator[httpx.Response]:
        """One request; its answer is read within the block.

        Raises:
            RegistryError: There is no answer, or the registry does not let us in.
        """
        httpx = _package()
        url = path if "://" in path else self._base + path
        try:
            answer = self._send(verb, url, headers or {}, data)
            if answer.status_code == 401 and self._ours(url):
                answer.read()
                self._header = self._login.answer(answer.headers.get("WWW-Authenticate", ""), self._scope)
                answer = self._send(verb, url, headers or {}, data)
            try:
                yield answer
            finally:
                answer.close()
        except httpx.HTTPError as error:
            raise RegistryError(
                f"`{self._host}` cannot be reached",
                code="DXB-E342",
                facts={"reason": str(error) or type(error).__name__, "address": url.split("?")[0]},
                hint=f"curl -I {self._base.split('/v2/')[0]}/v2/",
            ) from None

    def expect(self, answer: httpx.Response, status: int) -> httpx.Response:
        """The answer, if it has this status.

        Raises:
            RegistryError: It has another one.
        """
        if answer.status_code == status:
            return answer
        facts = {
            "status": answer.status_code,
            "says": _reason(answer),
            "request": f"{answer.request.method} {answer.url.path}",
        }
        if answer.status_code in (401, 403):
            raise RegistryError(
                f"`{self._host}` does not let you in", code="DXB-E343", facts=facts, hint=f"docker login {self._host}"
            )
        raise RegistryError(f"`{self._host}` refused", code="DXB-E344", facts=facts)

    def _send(self, verb: str, url: str, headers: Mapping[str, str], data: bytes | None) -> httpx.Response:
        own = {"Authorization": self._header} if self._header and self._ours(url) else {}
        # An iterator: a request and its answer hold each other, and would hold the bytes until they are collected.
        size = {"Content-Length": str(len(data))} if data is not None else {}
        content = _slices(data) if data is not None else None
        request = self._http.build_request(
            verb, url, content=content, headers={"Accept-Encoding": "identity", **size, **headers, **own}
        )
        # A registry may send readers elsewhere (to object storage); httpx leaves the login out of such requests.
        answer: httpx.Response = self._http.send(request, stream=True, follow_redirects=verb in ("GET", "HEAD"))
        return answer

    def _ours(self, url: str) -> bool:
        """Whether a URL is the registry's own; nobody else gets its login."""
        mine, other = urlsplit(self._base), urlsplit(url)
        return (mine.scheme, mine.netloc) == (other.scheme, other.netloc)


def _slices(data: bytes) -> Iterator[bytes]:
    for start in range(0, len(data), 1 << 20):
        yield data[start : start + (1 << 20)]


def _reason(answer: httpx.Response) -> str:
    """What a registry says of an error: `{"errors": [{"code", "message"}]}`."""
    try:
        found: Any = json.loads(answer.read())["errors"][0]
        text = f"{found['code']}: {found.get('message', '')}"
    except Exception:  # whatever it sent instead, it is shown as it is
        text = answer.reason_phrase
    return "".join(c for c in text if c.isprintable())[:300] or "-"


def _package() -> Any:
    try:
        import httpx
    except ImportError:
        raise MachineError(
            "registries need the package `httpx`", code="DXB-E340", hint="pip install 'dextera-build[share]'"
        ) from None
    return httpx
