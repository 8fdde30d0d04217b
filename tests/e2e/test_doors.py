"""Who may put results into a store: `require_signed`, and a server that others reach."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import httpx
import pytest

from dextera_build.remotes.http import HttpCache
from dextera_build.remotes.remote import RemoteFault
from dextera_build.remotes.server import CacheServer
from dextera_build.store.store import Store
from tests.e2e.space import Space
from tests.remotes.test_http_secrets import KEY

SIGNED = 'cache = "cache"\nrequire_signed = true\n'


@pytest.mark.parametrize(
    "words",
    [
        ("build", "say/words", "--cache", "local:rw,./share:r"),
        ("build", "say/words", "--cache", "local:rw,./share:rw"),
        ("plan", "say/words", "--cache", "local:rw,http://127.0.0.1:9:r"),
        ("cache", "pull", "say/words", "--from", "./share"),
    ],
)
def test_what_nobody_signed_does_not_come_from_a_remote(space: Space, words: tuple[str, ...]) -> None:
    space.write("dxb.toml", SIGNED)
    answer = space.dxb(*words)
    assert (answer.code, "error[DXB-U138]: `require_signed` is set" in answer.err) == (2, True), answer.err
    assert "--cache local:rw" in answer.err


def test_nor_from_one_that_the_settings_name_after_a_build(space: Space) -> None:
    space.write("dxb.toml", SIGNED)
    assert space.build("say/words").code == 0
    space.write("dxb.toml", SIGNED + '[remotes]\nshare = "share"\n')
    assert "error[DXB-U138]" in space.dxb("build", "say/words").err


def test_a_remote_that_is_only_written_is_no_door(space: Space) -> None:
    space.write("dxb.toml", SIGNED)
    assert space.build("say/words", "--cache", "local:rw,./share:w").code == 0
    assert list((space.root / "share" / "ac").rglob("*"))
    assert space.dxb("cache", "push", "say/words", "--to", "./share").code == 0


def test_a_server_does_not_take_what_is_not_signed(space: Space) -> None:
    space.write("dxb.toml", SIGNED)
    answer = space.dxb("cache", "serve", "--port", "0")
    assert (answer.code, "error[DXB-U138]" in answer.err, "--read-only" in answer.err) == (2, True, True)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "cache.example.org"])
def test_others_write_only_with_a_secret(space: Space, host: str) -> None:
    answer = space.dxb("cache", "serve", "--host", host, "--port", "0")
    assert (answer.code, "error[DXB-U139]" in answer.err) == (2, True), answer.err
    assert "export DXB_SERVE_SECRET=" in answer.err
    assert "--read-only" in answer.err


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--most", "nan"), "DXB-U150"),
        (("--most", "16"), "DXB-U150"),
        (("--tls", "nothing.pem"), "DXB-U146"),
        (("--tls", "dxb.toml"), "DXB-U146"),
    ],
)
def test_flags_that_make_no_sense_are_refused(space: Space, words: tuple[str, ...], code: str) -> None:
    answer = space.dxb("cache", "serve", "--port", "0", *words)
    assert (answer.code, f"error[{code}]" in answer.err) == (2, True), answer.err


def test_a_secret_and_tls_let_the_right_client_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pem = tmp_path / "cert.pem"
    subject = ("-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost")
    made = ("openssl", "req", "-x509", "-newkey", "ed25519", "-nodes", *subject, "-keyout", pem, "-out", pem)
    subprocess.run(made, check=True, capture_output=True)
    monkeypatch.setenv("SSL_CERT_FILE", str(pem))
    with CacheServer(Store(tmp_path / "store"), ("127.0.0.1", 0), secret="s3cret", tls=str(pem)) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        host = server.url.replace("https://127.0.0.1", "localhost")
        assert HttpCache(f"https://dxb:s3cret@{host}").get_entry(KEY) is None
        for address in (f"https://{host}", f"https://dxb:other@{host}"):
            with pytest.raises(RemoteFault, match="a name and a password"):
                HttpCache(address).get_entry(KEY)
        with pytest.raises(httpx.HTTPError):
            httpx.get(f"http://{host}/cas/{KEY}")
        server.shutdown()


def test_the_secret_is_asked_for(space: Space) -> None:
    words = [sys.executable, "-m", "dextera_build", "cache", "serve", "--host", "127.0.0.1", "--port", "0"]
    environment = space.environment(DXB_SERVE_SECRET="s3cret")
    with subprocess.Popen(words, cwd=space.root, env=environment, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        try:
            assert httpx.get(f"{url}/cas/{KEY}").status_code == 401
            assert httpx.get(f"{url}/cas/{KEY}", auth=("dxb", "s3cret")).status_code == 404
        finally:
            server.kill()
