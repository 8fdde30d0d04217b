"""dxb as a client of BuildGrid's server, and BuildGrid's clients at a server of ours."""

from __future__ import annotations

import json
import subprocess
import threading
import tracemalloc
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from dextera_build.store.reapi import OutputFile, encode
from dextera_build.store.remotes import action
from dextera_build.store.remotes import protocol as api
from dextera_build.store.remotes.grpc_server import GrpcServer
from dextera_build.store.remotes.reapi import Reapi
from dextera_build.store.remotes.remote import Digest, RemoteFault
from dextera_build.store.store import Store
from tests.store.remotes.buildgrid_server import bgd, program, python, running
from tests.store.remotes.grpc_servers import KEY, connected
from tests.store.remotes.things import Blobs, blob, digest_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """A server that the tests of this file share."""
    with running(tmp_path_factory.mktemp("buildgrid")) as (port, _):
        yield port


@pytest.mark.parametrize("instance", ["", "team/main"])
def test_blobs_of_every_size_go_and_come(port: int, instance: str) -> None:
    edge = api.BATCH - 128
    sizes = [0, 1, 1000, edge - 1, edge, edge + 1, api.BATCH, (4 << 20) - 1024, 4 << 20, 64 << 20]
    blobs = Blobs(*(blob(size, len(instance)) for size in sizes), *(blob(100, seed) for seed in range(1200)))
    with connected(port, instance) as remote:
        lacking = remote.missing(list(blobs))
        assert digest_of(blob(64 << 20, len(instance))) in lacking
        remote.send(list(blobs), blobs.give)
        assert remote.missing(list(blobs)) == set()
        came = Blobs()
        remote.fetch(list(blobs), came.take)
        assert came == blobs
        absent = [digest_of(b"nowhere"), Digest(digest_of(b"nowhere, either").hash, 50 << 20)]
        assert remote.missing([*absent, *blobs]) == set(absent)
        remote.fetch(absent, came.take)
        assert came == blobs


def test_results_go_and_come(port: int) -> None:
    document = b'{"rule":"a key document, which is no Action"}'
    blobs = Blobs(document, b"output")
    key = digest_of(document)
    files = [OutputFile("output", digest_of(b"output").hash, 6), OutputFile("key.json", key.hash, key.size)]
    message = encode([*files, OutputFile("result.json", digest_of(b"output").hash, 6, b"output")])
    with connected(port) as remote:
        assert remote.get_action(key) is None
        remote.send(list(blobs), blobs.give)
        remote.put_action(key, message)
        assert remote.get_action(key) == message
        assert remote.get_action(KEY) is None
        lost = encode([OutputFile("output", digest_of(b"never sent").hash, 10)])
        remote.put_action(KEY, lost)
        assert remote.get_action(KEY) is None  # BuildGrid gives no result whose blobs it lacks
    name = action.of_key(key).digest
    shown = json.loads(bgd(port, "actioncache", "get", f"{name.hash}/{name.size}", "--json"))
    assert [file["path"] for file in shown["outputFiles"]] == ["output", "key.json", "result.json"]


def test_what_stands_for_a_key_is_an_action(port: int, tmp_path: Path) -> None:
    """BuildGrid downloads the input root of the action: a folder with the key document."""
    document = b'{"rule":"toy.slow"}'
    standing, blobs = action.of_key(digest_of(document)), Blobs(document)
    with connected(port) as remote:
        remote.send(list(blobs), blobs.give)
        remote.put_action(digest_of(document), encode([OutputFile("key.json", *digest_of(document))]))
    root = next(digest for digest, data in standing.blobs.items() if b"key.json" in data)
    bgd(port, "cas", "download-dir", f"{root.hash}/{root.size}", str(tmp_path / "root"))
    assert (tmp_path / "root" / "key.json").read_bytes() == document


def test_large_blobs_are_never_whole_in_memory(port: int, tmp_path: Path) -> None:
    """Nor are they held by the threads that carry four of them at once."""
    for seed in range(4):
        (tmp_path / str(seed)).write_bytes(blob(24 << 20, 100 + seed))
    paths = {digest_of(path.read_bytes()): path for path in tmp_path.iterdir()}
    sizes: list[int] = []
    tracemalloc.start()
    try:
        with connected(port) as remote:
            remote.send(list(paths), lambda digest: paths[digest].open("rb"))
            remote.fetch(list(paths), lambda digest, pieces: sizes.append(sum(map(len, pieces))))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert sizes == [24 << 20] * 4
    assert peak < 48 << 20, f"{peak >> 20} MiB"


def test_a_server_that_is_killed_is_a_fault(tmp_path: Path) -> None:
    blobs = Blobs(*(blob(8 << 20, seed) for seed in range(12)))
    with running(tmp_path) as (port, server), connected(port, timeout_s=5) as remote:
        begun = threading.Event()

        def give(digest: Digest) -> object:
            if blobs.opened == 3:
                begun.set()
            return blobs.give(digest)

        threading.Thread(target=lambda: (begun.wait(30), server.kill())).start()
        with pytest.raises(RemoteFault):
            remote.send(list(blobs), give)  # type: ignore[arg-type]
        for call in (lambda: remote.get_action(KEY), lambda: remote.fetch(list(blobs), Blobs().take)):
            with pytest.raises(RemoteFault):
                call()


def test_a_server_that_takes_no_results_refuses(tmp_path: Path) -> None:
    with running(tmp_path, updates=False) as (port, _), connected(port) as remote:
        with pytest.raises(RemoteFault, match="takes no results") as caught:
            remote.put_action(KEY, encode([OutputFile("a", digest_of(b"").hash, 0)]))
        assert caught.value.refused


def test_a_token_opens_a_server_that_asks_for_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    secret = "a secret of thirty-two letters at the least"
    (tmp_path / "secret").write_text(secret)
    script = "import jwt, sys; print(jwt.encode({'exp': int(sys.argv[2])}, sys.argv[1], 'HS256'))"
    expires = str(int((datetime.now(UTC) + timedelta(hours=1)).timestamp()))
    made = subprocess.run([python(), "-c", script, secret, expires], capture_output=True, text=True, check=True)
    with running(tmp_path / "server", secret=str(tmp_path / "secret")) as (port, _):
        for token, opens in (("", False), ("wrong", False), (made.stdout.strip(), True)):
            monkeypatch.setenv("DXB_REMOTE_TOKEN", token)
            with connected(port) as remote:
                if opens:
                    assert remote.missing([KEY]) == {KEY}
                    continue
                with pytest.raises(RemoteFault, match=r"DXB_REMOTE_TOKEN") as caught:
                    remote.missing([KEY])
                assert caught.value.refused


def test_a_certificate_of_our_own_authority_is_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = (
        "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost "
        "-addext subjectAltName=DNS:localhost,IP:127.0.0.1 -keyout key.pem -out cert.pem"
    )
    subprocess.run(command.split(), cwd=tmp_path, check=True, capture_output=True)
    credentials = (
        "    credentials:\n"
        f"      tls-server-key: {tmp_path}/key.pem\n"
        f"      tls-server-cert: {tmp_path}/cert.pem"
    )  # fmt: skip
    with running(tmp_path / "server", credentials=credentials) as (port, _):
        for authority, opens in (("", False), (str(tmp_path / "cert.pem"), True)):
            monkeypatch.setenv("DXB_REMOTE_CA", authority)
            remote = Reapi(f"localhost:{port}", "", tls=True, timeout_s=10)
            if opens:
                assert remote.missing([KEY]) == {KEY}
            else:
                with pytest.raises(RemoteFault, match="no connection"):
                    remote.missing([KEY])
            remote.close()
        with connected(port) as plain, pytest.raises(RemoteFault):
            plain.missing([KEY])


def test_clients_of_buildgrid_use_a_server_of_ours(server: GrpcServer, store: Store, tmp_path: Path) -> None:
    capabilities = json.loads(bgd(server.port, "capabilities"))
    assert capabilities["cacheCapabilities"]["digestFunctions"] == ["SHA256"]
    assert capabilities["cacheCapabilities"]["actionCacheUpdateCapabilities"] == {"updateEnabled": True}
    assert bgd(server.port, "cas", "upload-dummy").count("Success") == 2
    (tmp_path / "up" / "below").mkdir(parents=True)
    contents = {"large": blob(9 << 20), "small": b"small", "empty": b"", "below/more": b"more"}
    for name, data in contents.items():
        (tmp_path / "up" / name).write_bytes(data)
    said = bgd(server.port, "cas", "upload-dir", str(tmp_path / "up"), "--verify")
    assert "Error" not in said
    for name, data in contents.items():
        if data:
            assert store.blobs.get(digest_of(data).hash) == data
            where = tmp_path / name.replace("/", "-")
            bgd(server.port, "cas", "download-file", "/".join(map(str, digest_of(data))), str(where))
            assert where.read_bytes() == data
    message = encode([OutputFile("large", *digest_of(contents["large"]))])
    store.blobs.put(message)
    result = "/".join(map(str, digest_of(message)))
    assert "Miss" in bgd(server.port, "actioncache", "get", "/".join(map(str, KEY)))
    bgd(server.port, "actioncache", "update", "/".join(map(str, KEY)), result)
    assert "Hit" in bgd(server.port, "actioncache", "get", "/".join(map(str, KEY)))
    assert program()
