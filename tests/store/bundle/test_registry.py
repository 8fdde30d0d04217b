"""Bundles in a real registry (Debian's docker-registry), read there by programs that others wrote."""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import yaml

from dextera_build.errors import MachineError, UsageError
from dextera_build.store.bundle import layout, oci, provenance, receive, registry, registry_login, signing, trust
from dextera_build.store.bundle.refusal import BundleRefused
from tests.store.bundle.conftest import bundle, large
from tests.store.remotes.servers import deaf_port, free_port

REPO = Path(__file__).parents[3]
HASH = "$2b$05$CCCCCCCCCCCCCCCCCCCCC.E5YPO9kmyuRGyh0XouQYb4YMJKvyOeW"  # "U*U", from bcrypt's own test vectors
ORAS = """
import sys, oras.client
target, folder = sys.argv[1:]
print("\\n".join(oras.client.OrasClient(insecure=True).pull(target=target, outdir=folder)))
"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("docker-registry") is None, reason="no docker-registry here"),
]
Serve = Callable[..., str]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Starts a registry with the configuration of `cache/registry.yml` and more; gives its host."""
    running: list[subprocess.Popen[bytes]] = []

    def start(**more: object) -> str:
        host = f"localhost:{free_port()}"
        config = yaml.safe_load((REPO / "cache" / "registry.yml").read_text())
        config["http"]["addr"] = host
        (tmp_path / "registry.yml").write_text(yaml.safe_dump(config | more))
        command = ["docker-registry", "serve", str(tmp_path / "registry.yml")]
        with (tmp_path / "registry.log").open("wb") as log:
            running.append(subprocess.Popen(command, cwd=tmp_path, stdout=log, stderr=log))
        until = time.monotonic() + 30
        while time.monotonic() < until:
            try:
                socket.create_connection(("localhost", int(host.partition(":")[2])), 1).close()
            except OSError:
                time.sleep(0.05)
            else:
                return host
        raise AssertionError((tmp_path / "registry.log").read_text())

    yield start
    for process in running:
        process.kill()
        process.wait()


@pytest.fixture(autouse=True)
def docker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Docker's folder, in which `docker login` leaves what it was told."""
    monkeypatch.setenv("DOCKER_CONFIG", str(tmp_path / "docker"))
    (tmp_path / "docker").mkdir()
    return tmp_path / "docker"


def at(text: str) -> registry.Repository:
    return registry.Repository(registry.parse(text))


def said(made, store):
    data = provenance.statement(made.manifest.digest, made.contents, store.blobs.get, provenance.Circumstances())
    made.attach(oci.IN_TOTO, data)
    return made


def test_what_is_pushed_comes_back(serve, tmp_path, store, other, plan):
    host = serve()
    made = said(bundle(store, plan, "full"), store)
    address = registry.push(made, registry.parse(f"oci://{host}/twins/tiny:v1"))
    assert address == f"oci://{host}/twins/tiny@sha256:{made.manifest.digest}"
    layout.write(made, tmp_path / "made.tar")
    for text in (f"oci://{host}/twins/tiny:v1", address):
        layout.write(at(text), tmp_path / "pulled.tar")
        assert (tmp_path / "pulled.tar").read_bytes() == (tmp_path / "made.tar").read_bytes()
    taken = receive.take(receive.open_bundle(at(address)), other)
    assert taken.new == len(list(store.actions.keys()))


def test_pushing_again_uploads_no_layer(serve, store, plan, monkeypatch):
    place = registry.parse(f"oci://{serve()}/tiny:v1")
    registry.push(said(bundle(store, plan), store), place)
    monkeypatch.setattr(registry.Repository, "write", lambda *_: pytest.fail("uploaded again"))
    registry.push(said(bundle(store, plan), store), place)
    assert len(at(str(place)).manifests()) == 2  # and its provenance stands there once


def test_two_things_may_be_said_of_one_bundle(serve, store, plan, tmp_path):
    place = registry.parse(f"oci://{serve()}/tiny:v1")
    registry.push(said(bundle(store, plan), store), place)
    signing.generate(tmp_path / "key", "anna")
    made = bundle(store, plan)
    data = provenance.statement(made.manifest.digest, made.contents, store.blobs.get, provenance.Circumstances())
    made.attach(oci.DSSE, signing.seal(data, tmp_path / "key")[0])
    registry.push(made, place)
    opened = receive.open_bundle(at(str(place)))
    assert len(opened.said) == 2
    assert trust.judge(opened, signing.trusted([tmp_path / "key.pub"])).state == "trusted"


def test_a_large_blob_goes_up_in_pieces(serve, store, other, plan, monkeypatch):
    monkeypatch.setattr(registry, "PIECE", 1000)
    host = serve()
    registry.push(bundle(store, plan, "full"), registry.parse(f"oci://{host}/tiny:v1"))
    assert receive.take(receive.open_bundle(at(f"oci://{host}/tiny:v1")), other).new > 0


def test_a_large_blob_is_never_in_memory(serve, tmp_path, store):
    """200 MiB go up while Python holds a few pieces."""
    made = large(store, tmp_path / "large", 200 << 20)
    place = registry.parse(f"oci://{serve()}/tiny:v1")
    tracemalloc.start()
    registry.push(made, place)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5 * registry.PIECE


def test_a_damaged_layer_in_the_registry_is_refused(serve, tmp_path, store, other, plan):
    host = serve()
    made = bundle(store, plan)
    registry.push(made, registry.parse(f"oci://{host}/tiny:v1"))
    pack = receive.open_bundle(made).manifest.layers[-1]
    (file,) = (tmp_path / "cache" / "registry").rglob(f"{pack.digest}/data")
    file.write_bytes(b"\0" * pack.size)
    with pytest.raises(BundleRefused) as error:
        receive.take(receive.open_bundle(at(f"oci://{host}/tiny:v1")), other)
    assert error.value.code == "DXB-S302"
    assert list(other.actions.keys()) == []


def test_what_is_not_there_is_said(serve, store, plan):
    host = serve()
    for text in (f"oci://{host}/nothing:v1", f"oci://{host}/nothing@sha256:{'0' * 64}"):
        with pytest.raises(MachineError, match="has no `nothing`") as error:
            at(text).manifests()
        assert error.value.code == "DXB-E341"
    with deaf_port() as port, pytest.raises(MachineError, match="cannot be reached") as error:
        at(f"oci://localhost:{port}/tiny:v1").manifests()
    assert error.value.code == "DXB-E342"


@pytest.mark.skipif(shutil.which("skopeo") is None, reason="no skopeo here")
def test_skopeo_reads_what_was_pushed_and_we_read_what_it_wrote(serve, tmp_path, store, other, plan):
    host = serve()
    made = bundle(store, plan, "full")
    registry.push(made, registry.parse(f"oci://{host}/tiny:v1"))
    command = ["skopeo", "inspect", "--tls-verify=false", "--raw", f"docker://{host}/tiny:v1"]
    shown = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    assert shown["artifactType"] == oci.BUNDLE
    copy = ["skopeo", "copy", "-q", "--src-tls-verify=false", "--dest-tls-verify=false"]
    subprocess.run([*copy, f"docker://{host}/tiny:v1", f"oci:{tmp_path}/theirs:v1"], check=True)
    layout.write(made, tmp_path / "ours")
    subprocess.run([*copy, f"oci:{tmp_path}/ours:bundle", f"docker://{host}/copied:v1"], check=True)
    subprocess.run([*copy, f"oci:{tmp_path}/ours:bundle", f"oci-archive:{tmp_path}/theirs.tar:v1"], check=True)
    for source in (
        layout.read(tmp_path / "theirs"),
        layout.read(tmp_path / "theirs.tar"),
        at(f"oci://{host}/copied:v1"),
    ):
        opened = receive.open_bundle(source)
        assert opened.descriptor.digest == made.manifest.digest
        receive.take(opened, other)
    assert set(other.actions.keys()) == set(store.actions.keys())


@pytest.fixture(scope="session")
def oras(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The Python of an environment with `oras`: the one that `DXB_TEST_ORAS` names, or a new one."""
    if named := os.environ.get("DXB_TEST_ORAS"):
        return named
    folder = tmp_path_factory.mktemp("oras")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    done = subprocess.run([folder / "bin" / "pip", "install", "-q", "oras>=0.2.40"], check=False, capture_output=True)
    if done.returncode:
        pytest.skip("oras cannot be installed here")
    return str(folder / "bin" / "python")


def test_oras_reads_what_was_pushed(serve, oras, tmp_path, store, plan):
    host = serve()
    registry.push(bundle(store, plan), registry.parse(f"oci://{host}/twins/tiny:v1"))
    command = [oras, "-c", ORAS, f"{host}/twins/tiny:v1", str(tmp_path / "pulled")]
    subprocess.run(command, check=True, capture_output=True)
    assert (tmp_path / "pulled" / "recipes" / "tiny" / "graph.yaml").read_bytes() == b"nodes: {}\n"
    names = subprocess.run(
        ["tar", "-tf", tmp_path / "pulled" / "blobs-0000.tar"], check=True, capture_output=True
    ).stdout
    assert names.startswith(b"cas/")


def login(docker: Path, host: str, name: str, password: str) -> None:
    secret = base64.b64encode(f"{name}:{password}".encode()).decode()
    (docker / "config.json").write_text(json.dumps({"auths": {host: {"auth": secret}}}))


def test_a_registry_with_passwords(serve, tmp_path, docker, store, plan):
    (tmp_path / "passwords").write_text(f"anna:{HASH}\n")
    host = serve(auth={"htpasswd": {"realm": "twins", "path": str(tmp_path / "passwords")}})
    place = registry.parse(f"oci://{host}/tiny:v1")
    with pytest.raises(MachineError, match="does not let you in") as error:
        registry.push(bundle(store, plan), place)
    assert (error.value.code, error.value.hint) == ("DXB-E343", f"docker login {host}")
    login(docker, host, "anna", "wrong")
    with pytest.raises(MachineError, match="does not let you in"):
        registry.push(bundle(store, plan), place)
    login(docker, host, "anna", "U*U")
    registry.push(bundle(store, plan), place)
    assert at(str(place)).manifests()


def test_a_helper_of_docker_gives_the_password(serve, tmp_path, docker, store, plan, monkeypatch):
    (tmp_path / "passwords").write_text(f"anna:{HASH}\n")
    host = serve(auth={"htpasswd": {"realm": "twins", "path": str(tmp_path / "passwords")}})
    helper = tmp_path / "bin" / "docker-credential-toy"
    helper.parent.mkdir()
    helper.write_text('#!/bin/sh\nread host\necho \'{"Username": "anna", "Secret": "U*U"}\'\n')
    helper.chmod(0o755)
    monkeypatch.setenv("PATH", f"{helper.parent}{os.pathsep}{os.environ['PATH']}")
    (docker / "config.json").write_text(json.dumps({"credHelpers": {host: "toy"}}))
    registry.push(bundle(store, plan), registry.parse(f"oci://{host}/tiny:v1"))


def test_a_registry_that_asks_for_tokens(serve, tmp_path, docker, store, plan):
    with Tokens(tmp_path / "ca.pem") as tokens:
        token = {"realm": tokens.url, "service": "twins", "issuer": "tests", "rootcertbundle": str(tmp_path / "ca.pem")}
        host = serve(auth={"token": token})
        place = registry.parse(f"oci://{host}/twins/tiny:v1")
        with pytest.raises(MachineError, match="does not let you in") as error:
            registry.push(bundle(store, plan), place)
        assert error.value.facts["reason"] == "it gave no token (status 403)"
        login(docker, host, "anna", "open sesame")
        registry.push(bundle(store, plan), place)
        assert at(str(place)).manifests()
        assert tokens.asked[-1] == ("twins", "repository:twins/tiny:pull")


def test_a_password_goes_nowhere_that_others_can_read(docker):
    login(docker, "example.org", "anna", "secret")
    asked = registry_login.Login(None, "example.org")  # type: ignore[arg-type]
    with pytest.raises(MachineError) as error:
        asked.answer('Bearer realm="http://example.org/token",service="x"', "scope")
    assert "others can read" in error.value.facts["reason"]


@pytest.mark.parametrize(
    "text",
    ["oci://", "oci://host", "oci://host/name", "oci://host/Name:v1", "oci://host/../x:v1", "http://host/name:v1",
     "oci://host/name@sha256:00", "oci://user@host/name:v1", "oci://host/name:v1/x"],
)  # fmt: skip
def test_an_address_of_another_form_is_refused(text):
    with pytest.raises(UsageError, match="not of the form") as error:
        registry.parse(text)
    assert error.value.code == "DXB-U147"


def test_an_address_is_read_as_it_is_written():
    for text in ("oci://localhost:5000/a/b-c:v1.0", f"oci://ghcr.io/a/b@sha256:{'0' * 64}", "oci://[::1]:5000/a:x"):
        assert str(registry.parse(text)) == text


class Tokens:
    """A token server for a registry: one name, one password, tokens signed with a key of its own."""

    def __init__(self, certificate: Path) -> None:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec

        self.asked: list[tuple[str, str]] = []
        self._key = ec.generate_private_key(ec.SECP256R1())
        name, now = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "tests")]), datetime.now(UTC)
        built = x509.CertificateBuilder(name, name, self._key.public_key(), 1, now, now + timedelta(days=1))
        signed = built.add_extension(x509.BasicConstraints(True, None), True).sign(self._key, hashes.SHA256())
        certificate.write_bytes(signed.public_bytes(serialization.Encoding.PEM))
        self._chain = base64.b64encode(signed.public_bytes(serialization.Encoding.DER)).decode()
        tokens = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                tokens.answer(self)

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}/token"

    def __enter__(self) -> Tokens:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        from urllib.parse import parse_qs, urlsplit

        asked = {name: values[0] for name, values in parse_qs(urlsplit(request.path).query).items()}
        self.asked.append((asked["service"], asked["scope"]))
        welcome = base64.b64encode(b"anna:open sesame").decode()
        if request.headers.get("Authorization") != f"Basic {welcome}":
            request.send_response(403)
            request.end_headers()
            return
        body = json.dumps({"token": self._token(asked["service"], asked["scope"])}).encode()
        request.send_response(200)
        request.end_headers()
        request.wfile.write(body)

    def _token(self, service: str, scope: str) -> str:
        from cryptography.hazmat.primitives import hashes
        from cryptography.hazmat.primitives.asymmetric import ec, utils

        kind, name, actions = scope.split(":")
        now = int(time.time())
        access = [{"type": kind, "name": name, "actions": actions.split(",")}]
        claims = {
            "iss": "tests",
            "sub": "anna",
            "aud": service,
            "exp": now + 300,
            "nbf": now - 10,
            "iat": now,
            "jti": "1",
        }
        head = _part({"typ": "JWT", "alg": "ES256", "x5c": [self._chain]})
        message = f"{head}.{_part(claims | {'access': access})}"
        r, s = utils.decode_dss_signature(self._key.sign(message.encode(), ec.ECDSA(hashes.SHA256())))
        return f"{message}.{_base64(r.to_bytes(32, 'big') + s.to_bytes(32, 'big'))}"


def _part(raw: object) -> str:
    return _base64(json.dumps(raw).encode())


def _base64(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")
