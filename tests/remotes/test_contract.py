"""The common behaviour of all remotes: a folder, our own servers, nginx, an object store."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from dextera_build.remotes.remote import Digest, Remote, RemoteFault
from dextera_build.remotes.spec import Spec, open_remote
from dextera_build.store.store import Store
from tests.remotes import servers
from tests.store.stores import entry, key_of, publish

KINDS = [
    "folder",
    "own",
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("nginx", "s3")),
]
"""Names of functions below; another remote is one more."""


@contextmanager
def folder(tmp_path: Path) -> Iterator[Spec]:
    yield Spec("lab", str(tmp_path / "share"), "rw")


@contextmanager
def own(tmp_path: Path) -> Iterator[Spec]:
    with servers.own(tmp_path / "served") as address:
        yield Spec("lab", address, "rw")


@contextmanager
def nginx(tmp_path: Path) -> Iterator[Spec]:
    with servers.nginx(tmp_path) as address:
        yield Spec("lab", address, "rw")


@contextmanager
def s3(tmp_path: Path) -> Iterator[Spec]:
    with servers.s3(tmp_path) as endpoint, pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ACCESS_KEY_ID", "anyone")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        yield Spec("lab", "s3://twins/a/prefix", "rw", options={"endpoint": endpoint, "region": "us-east-1"})


@pytest.fixture(params=KINDS)
def remote(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Remote]:
    with globals()[request.param](tmp_path) as spec, closing(open_remote(spec)) as opened:
        yield opened


def digest(data: bytes) -> Digest:
    return Digest(hashlib.sha256(data).hexdigest(), len(data))


def send(remote: Remote, *blobs: bytes) -> list[Digest]:
    for data in blobs:
        remote.send(digest(data), io.BytesIO(data))
    return [digest(data) for data in blobs]


def fetch(remote: Remote, *digests: Digest) -> dict[Digest, bytes]:
    found: dict[Digest, bytes] = {}

    def fetch_one(wanted: Digest) -> bool | None:
        def take(pieces: Iterator[bytes]) -> bool:
            found[wanted] = b"".join(pieces)
            return True

        return remote.fetch(wanted, take)

    assert [fetch_one(wanted) for wanted in digests] == [True if wanted in found else None for wanted in digests]
    return found


def test_blobs_come_back_as_they_went(remote: Remote) -> None:
    blobs = [b"", b"a", os.urandom(3_000_000), *(f"blob {number}".encode() for number in range(60))]
    sent = send(remote, *blobs)
    assert fetch(remote, *sent) == dict(zip(sent, blobs, strict=True))


def test_what_is_lacking_is_said_and_left_out(remote: Remote) -> None:
    (there,) = send(remote, b"there")
    lacking = digest(b"lacking")
    assert (remote.has(there), remote.has(lacking)) == (True, False)
    assert fetch(remote, there, lacking) == {there: b"there"}


def test_results_come_back_as_they_went(remote: Remote, tmp_path: Path) -> None:
    store = Store(tmp_path / "here")
    publish(store, "a", [b"blob"])
    message = entry(store, key_of("a")).read_bytes()
    send(remote, *(store.blobs.get(name) for name, _ in store.blobs.all()))
    key = key_of("a")
    assert remote.get_entry(key) is None
    remote.put_entry(key, message)
    assert remote.get_entry(key) == message


def test_a_blob_of_another_size_counts_as_missing(remote: Remote) -> None:
    (blob,) = send(remote, b"blob")
    assert not remote.has(Digest(blob.hash, 5))


def test_sending_twice_does_no_harm(remote: Remote) -> None:
    send(remote, b"twice")
    (blob,) = send(remote, b"twice")
    assert fetch(remote, blob) == {blob: b"twice"}


def test_a_reader_that_stops_early_harms_nobody(remote: Remote) -> None:
    (blob,) = send(remote, os.urandom(5_000_000))
    for _ in range(30):
        assert remote.fetch(blob, lambda pieces: not next(pieces)) is False
    assert digest(fetch(remote, blob)[blob]) == blob


def test_a_closed_remote_has_faults_and_nothing_else(remote: Remote) -> None:
    remote.close()
    if not remote.address.startswith("http"):
        pytest.skip("it has no connections")
    with pytest.raises(RemoteFault):
        remote.get_entry(key_of("a"))
