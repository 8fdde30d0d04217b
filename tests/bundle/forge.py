"""Forges bundles from a good one; all digests are correct, so a refusal is due to the change itself."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dextera_build.bundle import importer, layout, oci
from dextera_build.bundle.errors import BundleRefused
from dextera_build.digest import canonical, of_bytes
from dextera_build.store.store import Store

Raw = dict[str, Any]
END = bytes(2 * tarfile.BLOCKSIZE)


class Forgery:
    """An unpacked bundle in a folder; `write` reassembles it in place.

    Args:
        folder: The bundle.

    Attributes:
        files: Names and contents in its one archive of blobs.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._index = json.loads((folder / "index.json").read_bytes())
        self._manifest: Raw = json.loads(self._part(self._index["manifests"][0]["digest"]))
        self._config: Raw = json.loads(self._part(self._manifest["config"]["digest"]))
        self._manifest["layers"] = [la for la in self._manifest["layers"] if la["mediaType"] != oci.SIGNATURE]
        (self._pack,) = (layer for layer in self._manifest["layers"] if layer["mediaType"] == oci.PACK)
        with tarfile.open(fileobj=io.BytesIO(self._part(self._pack["digest"]))) as packed:
            self.files = [(info.name, packed.extractfile(info).read()) for info in packed]  # type: ignore[union-attr]
        self._more = self._tail = b""
        self._edits: list[Callable[[Raw], object]] = []
        self._text: bytes | None = None

    def add_file(self, name: str, data: bytes) -> Forgery:
        self._more += _header(name, len(data)) + data + bytes(-len(data) % tarfile.BLOCKSIZE)
        return self

    def add_kind(self, kind: bytes) -> Forgery:
        self._more += _header("cas/" + "0" * 64, 0, kind)
        return self

    def add_size(self, size: int) -> Forgery:
        self._more += _header("cas/" + "0" * 64, size)
        return self

    def add_tail(self, data: bytes) -> Forgery:
        self._tail = data
        return self

    def edit_manifest(self, change: Callable[[Raw], object]) -> Forgery:
        self._edits.append(change)
        return self

    def replace_manifest(self, text: bytes) -> Forgery:
        self._text = text
        return self

    def edit_config(self, change: Callable[[Raw], object]) -> Forgery:
        change(self._config)
        return self

    def edit_result(self, node: str, change: Callable[[Raw], object]) -> Forgery:
        entry = self.node(node)
        raw = json.loads(self.pop(entry["result"]))
        change(raw)
        entry["result"] = self.put(canonical(raw))
        return self

    def replace_output(self, node: str, header: bytes) -> Forgery:
        entry = self.node(node)
        entry["output"] = self.put(header)
        return self.edit_result(node, lambda raw: raw.update(output=entry["output"]))

    def node(self, name: str) -> Raw:
        found: Raw = next(node for node in self._config["builds"][0]["nodes"] if node["node"] == name)
        return found

    def put(self, data: bytes) -> str:
        name = f"cas/{of_bytes(data)}"
        self.files = [*((other, kept) for other, kept in self.files if other != name), (name, data)]
        return of_bytes(data)

    def pop(self, digest: str) -> bytes:
        found = dict(self.files)[f"cas/{digest}"]
        self.files = [(name, data) for name, data in self.files if name != f"cas/{digest}"]
        return found

    def write(self) -> Path:
        """Write the changed parts and return the folder."""
        packed = b"".join(
            _header(name, len(data)) + data + bytes(-len(data) % tarfile.BLOCKSIZE) for name, data in self.files
        )
        self._pack |= self._write(packed + self._more + END + self._tail)
        self._manifest["config"] |= self._write(canonical(self._config))
        for change in self._edits:
            change(self._manifest)
        data = canonical(self._manifest) if self._text is None else self._text
        self._index["manifests"][0] |= self._write(data)
        (self._folder / "index.json").write_bytes(canonical(self._index))
        return self._folder

    def _write(self, data: bytes) -> Raw:
        (self._folder / "blobs" / "sha256" / of_bytes(data)).write_bytes(data)
        return {"digest": f"sha256:{of_bytes(data)}", "size": len(data)}

    def _part(self, digest: str) -> bytes:
        return (self._folder / "blobs" / "sha256" / digest.removeprefix("sha256:")).read_bytes()


def _header(name: str, size: int, kind: bytes = tarfile.REGTYPE) -> bytes:
    info = tarfile.TarInfo(name)
    info.size, info.type = size, kind
    return info.tobuf(tarfile.GNU_FORMAT, "ascii", "strict")


def unpacked(path: Path) -> Path:
    """Unpack a bundle into a folder beside it."""
    with tarfile.open(path) as archive:
        archive.extractall(path.with_suffix(""), filter="data")
    return path.with_suffix("")


def packed(path: Path) -> Path:
    """Pack the parts in a folder into a bundle."""
    if path.is_dir():
        names = sorted(file.relative_to(path).as_posix() for file in path.rglob("*") if file.is_file())
        parts = [
            _header(name, len(data)) + data + bytes(-len(data) % tarfile.BLOCKSIZE)
            for name in names
            for data in [(path / name).read_bytes()]
        ]
        path = path.with_suffix(".again.tar")
        path.write_bytes(b"".join(parts) + END)
    return path


def take(path: Path, store: Store) -> importer.Taken:
    """Import the bundle at a path."""
    return importer.take(importer.open_bundle(layout.Layout(packed(path))), store)


def refused(path: Path, other: Store, code: str, *words: str) -> BundleRefused:
    """Import a bundle that must be refused and return the error; check that no result and no foreign file appeared."""
    path = packed(path)
    before = {place for place in other.root.parent.rglob("*") if not place.is_relative_to(other.root)}
    with pytest.raises(BundleRefused) as error:
        take(path, other)
    assert error.value.code == code, error.value.message
    for word in words:
        assert word in error.value.message
    assert error.value.message.isprintable()
    assert list(other.actions.keys()) == []
    assert {place for place in other.root.parent.rglob("*") if not place.is_relative_to(other.root)} == before
    assert list(other.root.rglob(".tmp-*")) == []
    for digest, _ in other.blobs.all():
        assert of_bytes(other.blobs.path(digest).read_bytes()) == digest
    return error.value
