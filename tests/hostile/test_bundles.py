"""What `dxb bundle import` does with archives that somebody made to do harm: one error, and nothing is written."""

from __future__ import annotations

import gzip
import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build.artifacts.base import Artifact
from dextera_build.bundle import oci
from dextera_build.digest import canonical, of_bytes
from dextera_build.errors import ArtifactError
from dextera_build.store import headers
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from tests.bundle.conftest import bundle, small
from tests.engine.tiny import run
from tests.hostile.conftest import listing, one_error

DOCKER = "application/vnd.docker.distribution.manifest.v2+json"
HELM = "application/vnd.cncf.helm.config.v1+json"


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A good bundle as an archive."""
    root = tmp_path_factory.mktemp("good")
    (root / "photo.bin").write_bytes(b"photo")
    plan, store = small(root / "photo.bin"), Store(root / "store")
    run(plan, store)
    bundle(store, plan, "full").write(root / "good.tar")
    return (root / "good.tar").read_bytes()


Files = list[tuple[tarfile.TarInfo, bytes]]


def packed(files: Files) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=tarfile.GNU_FORMAT) as archive:
        for info, data in files:
            archive.addfile(info, io.BytesIO(data))
    return out.getvalue()


def member(
    name: str, data: bytes = b"", kind: bytes = tarfile.REGTYPE, target: str = ""
) -> tuple[tarfile.TarInfo, bytes]:
    info = tarfile.TarInfo(name)
    info.size, info.type, info.linkname = len(data), kind, target
    return info, data


def huge() -> bytes:
    info = tarfile.TarInfo("index.json")
    info.size = 1 << 62
    return info.tobuf(tarfile.GNU_FORMAT)


def taken_apart(data: bytes) -> Files:
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        return [(info, archive.extractfile(info).read()) for info in archive]  # type: ignore[union-attr]


def adding(*members: tuple[tarfile.TarInfo, bytes]) -> Callable[[bytes], bytes]:
    return lambda data: packed([*members, *taken_apart(data)])


def with_index(change: Callable[[dict], object]) -> Callable[[bytes], bytes]:
    def changed(data: bytes) -> bytes:
        files = {info.name: body for info, body in taken_apart(data)}
        index = json.loads(files["index.json"])
        change(index)
        return packed(
            [member(name, canonical(index) if name == "index.json" else body) for name, body in files.items()]
        )

    return changed


def renamed(kind: str) -> Callable[[dict], None]:
    return lambda index: index["manifests"][0].update(mediaType=kind)


ARCHIVES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "a way up": (adding(member("../escape", b"x")), "S304"),
    "a way up behind a folder": (adding(member("blobs/sha256/../../../escape", b"x")), "S304"),
    "a place of the machine": (adding(member("/etc/dxb-was-here", b"x")), "S304"),
    "a way up of another system": (adding(member("..\\escape", b"x")), "S304"),
    "a drive": (adding(member("C:\\escape", b"x")), "S304"),
    "a name that speaks to the terminal": (adding(member("\x1b[2J", b"x")), "S304"),
    "a symbolic link": (adding(member("blobs", b"", tarfile.SYMTYPE, "/etc")), "S304"),
    "a link for the index": (adding(member("index.json", b"", tarfile.SYMTYPE, "/etc/passwd")), "S304"),
    "a hard link": (adding(member("oci-layout", b"", tarfile.LNKTYPE, "/etc/passwd")), "S304"),
    "a device": (adding(member("index.json", b"", tarfile.CHRTYPE)), "S304"),
    "a pipe": (adding(member("index.json", b"", tarfile.FIFOTYPE)), "S304"),
    "a file twice": (adding(member("index.json", b"{}")), "S304"),
    "a file that is no part": (adding(member("setup.py", b"import os")), "S304"),
    "a bomb of gzip": (lambda data: gzip.compress(bytes(1 << 20) + data), "S301"),
    "a bomb of zstd": (lambda data: b"\x28\xb5\x2f\xfd" + bytes(100), "S301"),
    "a size beyond the end": (lambda data: data[: len(data) // 2], "S304"),
    "an index of 20,000": (with_index(lambda index: index.update(manifests=index["manifests"] * 20_000)), "S305"),
    "an index of other things": (with_index(renamed(oci.INDEX)), "S301"),
    "an image of a container": (with_index(renamed(DOCKER)), "S301"),
    "a chart": (with_index(renamed(HELM)), "S301"),
    "an empty index": (with_index(lambda index: index.update(manifests=[])), "S301"),
    "an index of noise": (with_index(lambda index: index.update(manifests=[1, "x", None])), "S306"),
    "another size": (with_index(lambda index: index["manifests"][0].update(size=1)), "S302"),
    "another digest": (with_index(lambda index: index["manifests"][0].update(digest="sha256:" + "0" * 64)), "S303"),
    "a digest that leads out": (
        with_index(lambda index: index["manifests"][0].update(digest="sha256:../../x")),
        "S306",
    ),
    "an index in lists": (
        lambda data: packed(
            [member(i.name, b"[" * 100_000 if i.name == "index.json" else b) for i, b in taken_apart(data)]
        ),
        "S306",
    ),
    "another blob": (
        lambda data: packed([member(i.name, b + b"x" if "blobs/" in i.name else b) for i, b in taken_apart(data)]),
        "S302",
    ),
    "a name that is no text": (lambda data: packed([member("\udcff\udcfe")]), "S301"),
    "a later name that is no text": (adding(member("index.json"), member("\udcff\udcfe")), "S304"),
    "a size beyond all disks": (lambda data: huge() + data, "S304"),
    "nothing": (lambda data: b"", "S301"),
    "noise": (lambda data: of_bytes(data).encode() * 100, "S301"),
}


@pytest.mark.parametrize("name", ARCHIVES)
def test_an_archive_is_refused_and_nothing_is_written(project, dxb, good, name):
    make, code = ARCHIVES[name]
    (project.root / "bad.tar").write_bytes(make(good))
    before = listing(project.root.parent)
    said = one_error(dxb("bundle", "import", "bad.tar"), 1)
    assert f"DXB-{code}" in said
    after = {path: data for path, data in listing(project.root.parent).items() if "/cache/cas/" not in path}
    assert after == {path: data for path, data in before.items() if "/cache/cas/" not in path}
    assert not Path("/etc/dxb-was-here").exists()
    store = Store(project.root / "cache")
    assert list(store.actions.keys()) == []
    for digest, _ in store.blobs.all():
        assert of_bytes(store.blobs.path(digest).read_bytes()) == digest


def test_headers_that_name_one_another_in_a_circle_end(tmp_path, monkeypatch):
    """No digest allows that; a store whose bytes are not looked at would."""
    store = Store(tmp_path)
    one, two = "1" * 64, "2" * 64
    around = {one: two, two: one}

    def read(digest: str) -> bytes:
        return canonical({"artifact": "Collection", "fields": {"items": {"$map": {"a": {"$ref": around[digest]}}}}})

    monkeypatch.setattr(store.blobs, "get", read)
    monkeypatch.setattr(store.blobs, "size", lambda digest: 1)
    key = "3" * 64
    store.actions.put(key, ActionResult(one, "", (), {}, 1.0, None, key))
    entry = store.actions.entry(key)
    assert entry is not None
    assert entry.refers == {two}
    with pytest.raises(ArtifactError), headers.reading("a value"):
        Endless.decode(one, read)


class Endless(Artifact):
    """A type that holds itself."""

    items: dict[str, Endless]

    @classmethod
    def name(cls) -> str:
        return "Collection"
