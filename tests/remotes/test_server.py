"""`dxb cache serve` with malicious and faulty clients."""

from __future__ import annotations

import base64
import hashlib
import http.client
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from dextera_build.remotes import server
from dextera_build.store.store import Store
from tests.remotes import servers
from tests.store.stores import entry, key_of, publish

DATA = b"what a blob holds"
NAME = hashlib.sha256(DATA).hexdigest()
OTHER = hashlib.sha256(b"other").hexdigest()


class Client:
    """A client that sends any request."""

    def __init__(self, url: str) -> None:
        self.place = urlsplit(url).netloc

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection(self.place, timeout=10)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        found = answer.status, answer.read()
        connection.close()
        return found

    def raw(self, data: bytes) -> bytes:
        host, _, port = self.place.partition(":")
        with socket.create_connection((host, int(port)), timeout=10) as link:
            link.sendall(data)
            link.shutdown(socket.SHUT_WR)
            return b"".join(iter(lambda: link.recv(65536), b""))


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    with servers.own(tmp_path / "store", most_bytes=1000) as url:
        yield Client(url)


def inside(tmp_path: Path) -> set[str]:
    return {path.name for path in tmp_path.rglob("*") if path.is_file()}


def test_a_blob_goes_in_and_comes_out(client: Client) -> None:
    assert client.ask("GET", f"/cas/{NAME}")[0] == 404
    assert client.ask("HEAD", f"/cas/{NAME}")[0] == 404
    assert client.ask("PUT", f"/cas/{NAME}", DATA)[0] == 200
    assert client.ask("GET", f"/cas/{NAME}") == (200, DATA)
    assert client.ask("HEAD", f"/cas/{NAME}") == (200, b"")


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/cas/",
        "/cas/../../etc/passwd",
        f"/cas/../cas/{NAME}",
        f"/cas/{NAME[:2]}/{NAME[2:]}",
        f"/cas/{NAME.upper()}",
        f"/cas/{NAME}/",
        f"/cas/{NAME}%00",
        f"/cas/{NAME}?x=1",
        f"/local/{NAME}",
        "/cas/" + "%2e%2e%2f" * 8 + "x",
        "/cas/" + "." * 64,
        "/" + "a" * 60_000,
    ],
)
@pytest.mark.parametrize("method", ["GET", "HEAD", "PUT"])
def test_other_paths_are_not_there(client: Client, tmp_path: Path, method: str, path: str) -> None:
    before = inside(tmp_path)
    code, _ = client.ask(method, path, DATA if method == "PUT" else None)
    assert code in (400, 404)
    assert inside(tmp_path) == before


@pytest.mark.parametrize("body", [b"", DATA[:-1], DATA + b"x", b"X" + DATA[1:]])
def test_bytes_with_another_digest_are_refused(client: Client, tmp_path: Path, body: bytes) -> None:
    code, said = client.ask("PUT", f"/cas/{NAME}", body)
    assert (code, said) == (400, b"these bytes have another digest\n")
    assert client.ask("GET", f"/cas/{NAME}")[0] == 404
    assert not list((tmp_path / "store" / "cas").rglob(".tmp-*"))


def test_too_much_is_refused_before_it_is_sent(client: Client) -> None:
    answer = client.raw(b"PUT /cas/%s HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1001\r\n\r\n" % NAME.encode())
    assert answer.startswith(b"HTTP/1.1 413 ")
    huge = b"PUT /ac/%s HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999999\r\n\r\n" % NAME.encode()
    assert client.raw(huge).startswith(b"HTTP/1.1 413 ")


@pytest.mark.parametrize(
    "header", [b"", b"Content-Length: -5\r\n", b"Content-Length: x\r\n", b"Transfer-Encoding: chunked\r\n"]
)
def test_a_length_is_needed(client: Client, header: bytes) -> None:
    answer = client.raw(b"PUT /cas/%s HTTP/1.1\r\nHost: localhost\r\n%s\r\n0\r\n\r\n" % (NAME.encode(), header))
    assert answer.startswith(b"HTTP/1.1 411 ")


def test_an_upload_that_breaks_off_leaves_nothing(client: Client, tmp_path: Path) -> None:
    client.raw(b"PUT /cas/%s HTTP/1.1\r\nHost: localhost\r\nContent-Length: 17\r\n\r\nwhat a" % NAME.encode())
    assert client.ask("GET", f"/cas/{NAME}")[0] == 404
    assert not list((tmp_path / "store" / "cas").rglob(".tmp-*"))


def test_several_requests_share_a_connection(client: Client) -> None:
    put = b"PUT /cas/%s HTTP/1.1\r\nHost: localhost\r\nContent-Length: 17\r\n\r\n%s" % (NAME.encode(), DATA)
    get = b"GET /cas/%s HTTP/1.1\r\nHost: localhost\r\n\r\n" % NAME.encode()
    answer = client.raw(put + put + get + get)
    assert answer.count(b"HTTP/1.1 200 OK") == 4
    assert answer.count(DATA) == 2


def test_a_good_blob_is_never_replaced_and_a_damaged_one_is(client: Client, tmp_path: Path) -> None:
    client.ask("PUT", f"/cas/{NAME}", DATA)
    file = Store(tmp_path / "store").blobs.path(NAME)
    before = file.stat().st_ino
    assert client.ask("PUT", f"/cas/{NAME}", DATA)[0] == 200
    assert client.ask("PUT", f"/cas/{NAME}", b"X" + DATA[1:])[0] == 400
    assert file.stat().st_ino == before
    assert client.ask("GET", f"/cas/{NAME}") == (200, DATA)
    file.chmod(0o644)
    file.write_bytes(b"Y" + DATA[1:])
    assert client.ask("PUT", f"/cas/{NAME}", DATA)[0] == 200
    assert client.ask("GET", f"/cas/{NAME}") == (200, DATA)


def test_read_only_takes_nothing(tmp_path: Path) -> None:
    Store(tmp_path / "store").blobs.put(DATA)
    with servers.own(tmp_path / "store", read_only=True) as url:
        client = Client(url)
        assert client.ask("PUT", f"/cas/{OTHER}", b"other") == (405, b"this cache is read-only\n")
        assert client.ask("PUT", f"/ac/{OTHER}", b"")[0] == 405
        assert client.ask("GET", f"/cas/{NAME}") == (200, DATA)


def test_a_result_comes_after_its_blobs_and_goes_with_them(client: Client, tmp_path: Path) -> None:
    here, there = Store(tmp_path / "here"), Store(tmp_path / "store")
    publish(here, "a", [DATA])
    message = entry(here, key_of("a")).read_bytes()
    for name, _ in here.blobs.all():
        if name != NAME:
            client.ask("PUT", f"/cas/{name}", here.blobs.get(name))
    code, said = client.ask("PUT", f"/ac/{key_of('a')}", message)
    assert code == 400
    assert NAME.encode() in said
    assert list(there.actions.keys()) == []
    client.ask("PUT", f"/cas/{NAME}", DATA)
    assert client.ask("PUT", f"/ac/{key_of('a')}", message)[0] == 200
    assert client.ask("GET", f"/ac/{key_of('a')}") == (200, message)
    there.blobs.path(NAME).unlink()
    assert client.ask("GET", f"/ac/{key_of('a')}")[0] == 404


@pytest.mark.parametrize("body", [b"\xff", b"\x12\xff", b"\x12\x03abc", b"\x0b", b"x" * 999])
def test_what_is_no_result_is_refused(client: Client, body: bytes) -> None:
    code, said = client.ask("PUT", f"/ac/{OTHER}", body)
    assert code == 400
    assert said.startswith(b"this is not an entry of dxb")


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:8098"},
        {"Host": "127.0.0.1.evil.example"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Host": "localhost", "Origin": "http://localhost"},
    ],
)
@pytest.mark.parametrize("method", ["GET", "PUT"])
def test_web_pages_are_not_served(client: Client, tmp_path: Path, method: str, headers: dict[str, str]) -> None:
    Store(tmp_path / "store").blobs.put(b"other")
    body = DATA if method == "PUT" else None
    code, said = client.ask(method, f"/cas/{NAME if body else OTHER}", body, **headers)
    assert (code, said) == (403, b"web pages, and names of other machines, are not served\n")
    assert not Store(tmp_path / "store").blobs.has(NAME)


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:1", "127.0.0.1:8098", "[::1]:8098", "192.0.2.7"])
def test_its_own_names_and_addresses_are_served(client: Client, host: str) -> None:
    assert client.ask("PUT", f"/cas/{NAME}", DATA, Host=host)[0] == 200


def test_a_secret_admits_whatever_the_name(tmp_path: Path) -> None:
    with servers.own(tmp_path / "store", secret="geheim") as url:
        welcome = "Basic " + base64.b64encode(b"dxb:geheim").decode()
        client = Client(url)
        assert client.ask("PUT", f"/cas/{NAME}", DATA, Host="cache.lab.example", Authorization=welcome)[0] == 200
        assert client.ask("GET", f"/cas/{NAME}", Host="cache.lab.example")[0] == 401


@pytest.mark.parametrize(
    "sent",
    [b"", b"GET /cas/", b"PUT /cas/%s HTTP/1.1\r\nHost: localhost\r\nContent-Length: 17\r\n\r\nwh" % NAME.encode()],
)
def test_a_client_that_sends_a_byte_now_and_then_is_dropped(
    client: Client, monkeypatch: pytest.MonkeyPatch, sent: bytes
) -> None:
    monkeypatch.setattr(server, "_IDLE_S", 0.2)
    host, _, port = client.place.partition(":")
    with socket.create_connection((host, int(port)), timeout=10) as link:
        link.sendall(sent)
        with suppress(ConnectionError):
            while True:
                link.sendall(b"w")
                time.sleep(0.02)


def test_only_so_many_connections_are_open_and_the_next_are_served_when_they_end(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "_MOST_CONNECTIONS", 3)
    host, _, port = client.place.partition(":")
    links = [socket.create_connection((host, int(port)), timeout=10) for _ in range(4)]
    links[3].settimeout(10)
    assert links[3].recv(1) == b""
    for link in links:
        link.close()
    while True:  # the threads of the others end soon
        with suppress(OSError):
            assert client.ask("PUT", f"/cas/{NAME}", DATA)[0] == 200
            break


def test_large_entries_are_in_memory_one_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_LARGE_ENTRY", 100)
    most, now = 0, 0

    def publish(*words: object) -> None:
        nonlocal most, now
        now += 1
        most = max(most, now)
        time.sleep(0.05)
        now -= 1

    monkeypatch.setattr(server, "_publish", publish)
    with servers.own(tmp_path / "store") as url, ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(Client(url).ask, "PUT", f"/ac/{OTHER}", b"x" * 200) for _ in range(4)]
        assert [each.result()[0] for each in asked] == [200] * 4
    assert most == 1
