"""Passwords and tokens of an HTTP remote: where they are sent, and where they never are."""

from __future__ import annotations

import base64
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import pytest

from dextera_build.errors import UsageError
from dextera_build.remotes import http
from dextera_build.remotes.remote import RemoteFault
from dextera_build.remotes.spec import Spec, guarded, open_remote

KEY = "0" * 64


@pytest.fixture
def asked() -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """A server, and the path and authorization of each request to it."""
    told: list[tuple[str, str]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            told.append((self.path, self.headers.get("Authorization", "")))
            self.send_response(500 if "broken" in self.path else 404)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield f"127.0.0.1:{server.server_port}", told
        server.shutdown()


def test_user_and_query_are_sent_to_this_machine(asked):
    host, told = asked
    remote = open_remote(Spec("lab", f"http://anna:pw@{host}/dxb?token=a%2Fb"))
    assert remote.get_entry(KEY) is None
    assert told == [(f"/dxb/ac/{KEY}?token=a%2Fb", f"Basic {base64.b64encode(b'anna:pw').decode()}")]


def test_a_fault_names_neither(asked):
    host, _ = asked
    with pytest.raises(RemoteFault) as caught:
        open_remote(Spec("lab", f"http://anna:geheim@{host}/broken?token=geheim")).get_entry(KEY)
    assert "geheim" not in f"{caught.value} {caught.value.address} {caught.value.reason}"


@pytest.mark.parametrize("address", ["http://anna:geheim@192.0.2.1/x", "http://192.0.2.1/x?token=geheim"])
def test_a_password_goes_to_another_machine_over_tls_alone(address):
    with pytest.raises(UsageError) as caught:
        open_remote(Spec("lab", address))
    assert caught.value.code == "DXB-U137"
    assert "https://" in str(caught.value.hint)
    assert "geheim" not in f"{caught.value.message} {caught.value.facts} {caught.value.hint}"
    open_remote(Spec("lab", address.replace("http:", "https:"))).close()


def test_so_does_one_from_the_environment(monkeypatch):
    monkeypatch.setenv("WHO", "anna:geheim@192.0.2.1")
    remote = guarded(Spec("lab", "http://${WHO}/x"))
    with pytest.raises(RemoteFault) as caught:
        remote.get_entry(KEY)
    assert "in the clear" in caught.value.reason
    assert "geheim" not in str(caught.value)


def test_a_variable_may_not_bring_another_protocol(monkeypatch):
    for address in ("ftp://anna:geheim@h/x", "HTTP://anna:geheim@192.0.2.1/x"):
        monkeypatch.setenv("WHERE", address)
        with pytest.raises(UsageError) as caught:
            open_remote(Spec("lab", "${WHERE}"))
        assert caught.value.code == "DXB-U131"
        assert "geheim" not in caught.value.message


def test_so_do_those_of_a_netrc_file(tmp_path: Path, monkeypatch):
    (tmp_path / "netrc").write_text("default login anna password geheim\n")
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))
    assert http._netrc(httpx.URL("http://192.0.2.1/x")) is None
    assert http._netrc(httpx.URL("https://192.0.2.1/x")) is not None
    assert http._netrc(httpx.URL("http://127.0.0.1:8098/x")) is not None


@pytest.mark.parametrize("address", ["https://anna:ge/heim@host/x", "https://anna:ge#heim@host/x"])
def test_a_password_that_is_not_encoded_is_not_quoted(address):
    with pytest.raises(UsageError) as caught:
        open_remote(Spec("lab", address))
    assert caught.value.code == "DXB-U131"
    assert "heim" not in f"{caught.value.message} {caught.value.facts} {caught.value.hint}"
