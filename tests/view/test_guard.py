"""Who may talk to the viewer: real requests and web socket handshakes, with the headers that browsers send."""

from __future__ import annotations

import http.client
import socket
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest

from dextera_build.errors import UsageError
from dextera_build.view import server
from dextera_build.view.guard import Guard

HUB = "https://hub.example.org"


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    pytest.importorskip("viser")
    running, url = server.start(port=8640, origins=[HUB])
    yield int(urlsplit(url).port or 0)
    server.stop(running)


def page(port: int, **headers: str) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.putrequest("GET", "/", skip_host=True)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    with connection.getresponse() as answer:
        return answer.status


def socket_answers(port: int, **headers: str) -> bool:
    """Whether a handshake with viser's sub-protocol succeeds and a message comes."""
    import viser
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    host = headers.pop("Host")
    try:
        with connect(
            f"ws://{host}/",
            sock=socket.create_connection(("127.0.0.1", port), timeout=60),
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            additional_headers=headers,
            max_size=None,
        ) as opened:
            return bool(opened.recv(timeout=60))
    except InvalidStatus as refused:
        return refused.response.status_code != 403


ADMITTED = [
    {"Host": "127.0.0.1:{port}"},
    {"Host": "localhost:{port}"},
    {"Host": "127.0.0.1:{port}", "Origin": "http://127.0.0.1:{port}"},
    {"Host": "localhost:9000", "Origin": "http://localhost:9000"},  # an ssh tunnel from another port
    {"Host": "[::1]:{port}", "Origin": "http://[::1]:{port}"},
    {"Host": "hub.example.org", "Origin": HUB},
    {"Host": "127.0.0.1:{port}", "Origin": HUB},
]
REFUSED = [
    {"Host": "127.0.0.1:{port}", "Origin": "http://evil.example"},
    {"Host": "127.0.0.1:{port}", "Origin": "null"},
    {"Host": "127.0.0.1:{port}", "Origin": "http://127.0.0.1:3000"},  # another server of this machine
    {"Host": "evil.example:{port}"},  # a name that was made to point here
    {"Host": "evil.example:{port}", "Origin": "http://evil.example:{port}"},
    {"Host": "localhost.evil.example"},
    {"Host": "127.0.0.1:{port}", "Origin": "https://hub.example.org.evil.example"},
    {"Host": "127.0.0.1:{port}", "Origin": "https://hub.example.org:444"},
]


@pytest.mark.parametrize("headers", ADMITTED, ids=str)
def test_own_and_allowed_pages_are_served(port: int, headers: dict[str, str]) -> None:
    spelled = {name: value.format(port=port) for name, value in headers.items()}
    assert page(port, **spelled) == 200
    assert socket_answers(port, **spelled)


@pytest.mark.parametrize("headers", REFUSED, ids=str)
def test_other_pages_get_nothing(port: int, headers: dict[str, str]) -> None:
    spelled = {name: value.format(port=port) for name, value in headers.items()}
    assert page(port, **spelled) == 403
    assert not socket_answers(port, **spelled)


def test_a_request_without_a_host_is_refused() -> None:
    assert Guard("127.0.0.1").refusal(None, None)
    assert Guard("127.0.0.1").refusal("[", None)


def test_a_server_for_a_network_is_reached_by_its_names_and_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "Bench")
    guard = Guard("0.0.0.0")
    assert not guard.refusal("bench:8080", "http://bench:8080")
    assert not guard.refusal("10.0.0.7:8080", "http://10.0.0.7:8080")
    assert guard.refusal("evil.example:8080", "http://evil.example:8080")


@pytest.mark.parametrize(
    "text", ["hub.example.org", "https://", "ftp://a", "https://a/b", "https://u@a", "*", "http://[", "http://a:x"]
)
def test_what_is_no_origin_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is not an origin"):
        Guard("127.0.0.1", [text])


def test_an_address_of_another_machine_is_refused() -> None:
    pytest.importorskip("viser")
    with pytest.raises(UsageError, match=r"`192.0.2.1` is not an address of this machine"):
        server.start(host="192.0.2.1")


def test_the_server_of_others_is_left_as_it_was() -> None:
    from websockets.asyncio import server as sockets

    before = sockets.serve
    with Guard("127.0.0.1").installed():
        assert sockets.serve is not before
    assert sockets.serve is before
