"""Access control of the viewer: checks of `Origin` and `Host` for every request, web sockets included.

Browsers let any page open a web socket to this machine, so without these checks any open page could read the scene.
`Origin` identifies pages of other sites; `Host` exposes names that were made to point at this machine (DNS
rebinding), because they are not its own names.
"""

from __future__ import annotations

import contextlib
import functools
import gzip
import http
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from urllib.parse import urlsplit

from dextera_build.errors import UsageError
from dextera_build.remotes.remote import is_named
from dextera_build.view import panel


class Guard:
    """Admits requests from the viewer's own pages and from allowed origins.

    Args:
        host: The address that the server listens on.
        origins: Further allowed origins, `https://hub.example.org`: a notebook's proxy, a tunnel.

    Raises:
        UsageError: One of `origins` is not an origin.
    """

    def __init__(self, host: str, origins: Sequence[str] = ()) -> None:
        self._origins = {_origin(text) for text in origins}
        names = {"localhost", host, socket.gethostname(), *(urlsplit(origin).hostname for origin in self._origins)}
        self._names = {name.lower() for name in names if name}
        self._told: set[str] = set()

    def refusal(self, host: str | None, origin: str | None) -> str:
        """Why a request with these headers is refused, or ""."""
        allowed = origin is not None and origin.lower() in self._origins
        if not allowed and not is_named(host or "", self._names):
            return f"host {host!a} is not a name of this viewer; `--allow-origin` admits the pages of a proxy or tunnel"
        if origin is None or allowed or origin.lower() in (f"http://{host}".lower(), f"https://{host}".lower()):
            return ""
        return f"a page of {origin!a} asked for the scene; `--allow-origin ORIGIN` admits a page that you trust"

    def check(self, follow: Callable[..., Any] | None, connection: Any, request: Any) -> Any:
        """Handle a request before `follow`, the server's own handler: a response if it is refused."""
        refused = self.refusal(request.headers.get("Host"), request.headers.get("Origin"))
        if not refused:
            return None if follow is None else _dressed(follow(connection, request))
        if refused not in self._told and len(self._told) < 20:
            self._told.add(refused)
            print(f"refused: {refused}", file=sys.stderr)
        return connection.respond(http.HTTPStatus.FORBIDDEN, "dxb view does not serve this page\n")

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Attach this guard to servers started in the meantime; viser has no parameter for it."""
        from websockets.asyncio import server

        serve: Any = server.serve

        @functools.wraps(serve)
        def guarded(*words: Any, process_request: Any = None, **named: Any) -> Any:
            return serve(*words, process_request=functools.partial(self.check, process_request), **named)

        server.serve = guarded  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            server.serve = serve  # type: ignore[misc]


def _dressed(response: Any) -> Any:
    """A response of viser with our script, if it is the page."""
    if response is None or not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    packed = response.headers.get("Content-Encoding") == "gzip"
    page = (gzip.decompress(response.body) if packed else response.body).decode()
    body = panel.inserted(page, panel.script()).encode()
    response.body = gzip.compress(body) if packed else body
    if "Content-Length" in response.headers:
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))
    return response


def _origin(text: str) -> str:
    """An origin as browsers spell it."""
    try:
        parts = urlsplit(text)
        fits = parts.scheme in ("http", "https") and parts.hostname and (parts.port or 1)
    except ValueError:
        fits = False
    if not fits or parts.path.strip("/") or parts.query or parts.fragment or "@" in parts.netloc:
        raise UsageError(
            f"`{text}` is not an origin",
            code="DXB-U321",
            hint="an origin is scheme, host and port: `--allow-origin https://hub.example.org`",
        )
    return f"{parts.scheme}://{parts.netloc}".lower()
