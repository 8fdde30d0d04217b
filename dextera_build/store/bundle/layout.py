"""OCI image layouts: a folder, or the same in one tar archive."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from dextera_build.errors import UsageError
from dextera_build.store import failpoints, files
from dextera_build.store.bundle import checked, oci, tar
from dextera_build.store.bundle.oci import Descriptor, Manifest, Source
from dextera_build.store.bundle.refusal import MAGIC, BundleRefused, archive, lacking, not_a_bundle, too_large
from dextera_build.store.cas import is_digest

_VERSION = b'{"imageLayoutVersion":"1.0.0"}'
_BLOBS = "blobs/sha256/"
_MOST_FILES = 3 * oci.MOST_LAYERS


class Folder:
    """A source: a layout in a folder.

    Args:
        root: The folder.

    Raises:
        BundleRefused: It is no layout.
    """

    def __init__(self, root: Path) -> None:
        self.name = str(root)
        self._root = os.path.abspath(root)

    def manifests(self) -> list[Descriptor]:
        """The bundle's manifest first."""
        return _choose(self, b"".join(_bounded(self._chunks("index.json"), "`index.json`", oci.MOST_MANIFEST)))

    def chunks(self, wanted: Descriptor) -> Iterator[bytes]:
        """The bytes of a blob of the layout."""
        try:
            yield from self._chunks(_BLOBS + wanted.digest)
        except FileNotFoundError:
            raise lacking(f"a part of type `{wanted.media_type}`", wanted.digest) from None

    def _chunks(self, name: str) -> Iterator[bytes]:
        # A link would lead out of the folder, and a pipe would never end.
        descriptor = -1
        try:
            descriptor = os.open(f"{self._root}/{name}", os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            if os.path.realpath(f"{self._root}/{name}") != os.path.join(os.path.realpath(self._root), name):
                raise archive(name, "lies behind a link")
            yield from files.chunks(descriptor)
        except FileNotFoundError:
            if name == "index.json":
                raise not_a_bundle(self.name, "it has no `index.json`") from None
            raise
        except OSError as error:
            raise archive(name, f"cannot be read ({error.strerror})") from None
        finally:
            if descriptor >= 0:
                os.close(descriptor)


class Archive:
    """A source: a layout in a tar archive.

    Args:
        path: The archive.

    Raises:
        BundleRefused: It is none, or holds what no layout holds.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self._path = path
        self._places: dict[str, tuple[int, int]] = {}
        with path.open("rb") as file:
            start = file.read(8)
            for magic, kind in MAGIC.items():
                if start.startswith(magic):
                    raise not_a_bundle(
                        self.name, f"it is compressed ({kind})", "unpack it first; bundles are plain tar"
                    )
            file.seek(0)
            self._list(file, path.stat().st_size)

    def manifests(self) -> list[Descriptor]:
        """The bundle's manifest first."""
        if "index.json" not in self._places:
            raise not_a_bundle(self.name, "it has no `index.json`")
        size = self._places["index.json"][1]
        if size > oci.MOST_MANIFEST:
            raise too_large("`index.json`", size, oci.MOST_MANIFEST)
        return _choose(self, b"".join(self._chunks("index.json")))

    def chunks(self, wanted: Descriptor) -> Iterator[bytes]:
        """The bytes of a blob of the layout."""
        if _BLOBS + wanted.digest not in self._places:
            raise lacking(f"a part of type `{wanted.media_type}`", wanted.digest)
        yield from self._chunks(_BLOBS + wanted.digest)

    def _chunks(self, name: str) -> Iterator[bytes]:
        place, size = self._places[name]
        with self._path.open("rb") as file:
            file.seek(place)
            while size:
                chunk = file.read(min(size, 1 << 20))
                if not chunk:
                    raise archive(name, "is cut off")
                size -= len(chunk)
                yield chunk

    def _list(self, file: BinaryIO, total: int) -> None:
        while True:
            block = file.read(tar.BLOCK)
            found = tar.read_header(block, folders=True) if block else None
            if found is None:
                break
            name = found.name.removeprefix("./")
            if found.size < 0:
                continue
            digest = name.removeprefix(_BLOBS)
            if name not in ("oci-layout", "index.json") and not (name.startswith(_BLOBS) and is_digest(digest)):
                raise archive(found.name[:200], "is no part of an OCI image layout")
            if name in self._places:
                raise archive(name, "stands twice")
            place = file.tell()
            if place + found.size > total:
                raise archive(name, "is cut off")
            self._places[name] = (place, found.size)
            if len(self._places) > _MOST_FILES:
                raise too_large("the list of files", len(self._places), _MOST_FILES)
            file.seek(place + found.size + -found.size % tar.BLOCK)


class FolderSink:
    """Writes a layout into a folder; `index.json` comes last.

    Args:
        root: The folder; new or empty.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._manifests: list[Descriptor] = []

    def has(self, part: Descriptor) -> bool:
        """Whether it was written."""
        return (self._root / _BLOBS / part.digest).exists()

    def write(self, part: Descriptor, chunks: Iterator[bytes]) -> None:
        """Write a blob, all or nothing."""
        with files.new_file(str(self._root / _BLOBS / part.digest), 0o644) as descriptor:
            for chunk in chunks:
                files.write_all(descriptor, chunk)

    def manifest(self, found: Descriptor, data: bytes) -> None:
        """Write a manifest and name it in the index."""
        self.write(found, iter([data]))
        self._manifests.append(found)

    def close(self) -> None:
        """Write what makes it a layout."""
        files.write(str(self._root / "oci-layout"), _VERSION, 0o644)
        failpoints.reach("bundle.index")
        files.write(str(self._root / "index.json"), _index(self._manifests), 0o644)


class ArchiveSink:
    """Writes a layout as one tar archive.

    Args:
        descriptor: Takes the bytes.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._written: set[str] = set()
        self._manifests: list[Descriptor] = []

    def has(self, part: Descriptor) -> bool:
        """Whether it was written."""
        return part.digest in self._written

    def write(self, part: Descriptor, chunks: Iterator[bytes]) -> None:
        """Append a blob."""
        self._written.add(part.digest)
        self._file(_BLOBS + part.digest, part.size, chunks)

    def manifest(self, found: Descriptor, data: bytes) -> None:
        """Append a manifest and name it in the index."""
        self.write(found, iter([data]))
        self._manifests.append(found)

    def close(self) -> None:
        """Append what makes it a layout."""
        index = _index(self._manifests)
        self._file("oci-layout", len(_VERSION), iter([_VERSION]))
        self._file("index.json", len(index), iter([index]))
        files.write_all(self._descriptor, tar.end())

    def _file(self, name: str, size: int, chunks: Iterator[bytes]) -> None:
        files.write_all(self._descriptor, tar.header(name, size))
        for chunk in chunks:
            files.write_all(self._descriptor, chunk)
        files.write_all(self._descriptor, tar.padding(size))


def read(path: Path) -> Folder | Archive:
    """The layout at a path.

    Raises:
        BundleRefused: There is none.
    """
    if path.is_dir():
        return Folder(path)
    try:
        return Archive(path)
    except OSError as error:
        raise not_a_bundle(str(path), f"it cannot be read ({error.strerror})") from None
    except BundleRefused as error:
        if error.message.startswith("an archive of the bundle is refused: `?` is no header"):
            raise not_a_bundle(str(path), "it is no tar archive") from None
        raise


def write(source: Source, path: Path) -> list[Descriptor]:
    """Copy a bundle to a file `NAME.tar`, or to a folder, and return its manifests.

    Raises:
        UsageError: The name says neither, or the folder holds something else than an unfinished bundle.
        StoreError: The disk is full, or the place cannot be written.
    """
    if path.suffix == ".tar" and not path.is_dir():
        with files.new_file(os.path.abspath(path), 0o644) as descriptor:
            packed = ArchiveSink(descriptor)
            found = checked.copy(source, packed)
            packed.close()
        return found
    if path.suffix and not path.is_dir():
        raise UsageError(
            f"`{path}` is neither a folder nor a `.tar`", code="DXB-U140", hint=f"`-o {path.with_suffix('.tar')}`"
        )
    _make_room(path)
    spread = FolderSink(path)
    found = checked.copy(source, spread)
    spread.close()
    return found


def _make_room(path: Path) -> None:
    """See that a folder is empty; the blobs of an attempt that was cut off before it wrote its index go.

    Raises:
        UsageError: It holds something else.
    """
    try:
        found = set(os.listdir(path))
    except (FileNotFoundError, NotADirectoryError):
        return
    if found and not (found <= {"blobs", "oci-layout"} and _are_blobs(path / "blobs")):
        raise UsageError(f"the folder `{path}` is not empty", code="DXB-U141", hint="name a new folder")
    if found:
        shutil.rmtree(path / "blobs")


def _are_blobs(folder: Path) -> bool:
    """Whether a folder holds blobs of a layout, finished or not, and nothing else."""
    try:
        names = os.listdir(folder / "sha256")
        return os.listdir(folder) == ["sha256"] and all(map(_is_blob, names))
    except OSError:
        return False


def _is_blob(name: str) -> bool:
    return is_digest(name) or name.startswith(f"{files.TEMPORARY}-")


def _choose(source: Source, index: bytes) -> list[Descriptor]:
    """The one bundle that an index names, and what is said of it."""
    bundles, others = [], []
    for descriptor in oci.read_index(index):
        if descriptor.media_type != oci.MANIFEST:
            continue
        manifest = Manifest.read(checked.whole(source, descriptor, "the manifest", oci.MOST_MANIFEST))
        if manifest.artifact_type == oci.BUNDLE:
            bundles.append(descriptor)
        elif manifest.artifact_type in oci.ATTESTATIONS and manifest.subject is not None:
            others.append((manifest.subject.digest, descriptor))
    if len({bundle.digest for bundle in bundles}) != 1:
        raise not_a_bundle(source.name, f"its index names {len(bundles)} manifests of type `{oci.BUNDLE}`, not one")
    return [bundles[0], *(descriptor for subject, descriptor in others if subject == bundles[0].digest)]


def _index(manifests: list[Descriptor]) -> bytes:
    """The index of a layout; other programs name the bundle as `oci:FOLDER:bundle`."""
    first, *others = manifests
    return oci.spell_index([replace(first, annotations={oci.REF: "bundle"}), *others])


def _bounded(chunks: Iterator[bytes], name: str, most: int) -> Iterator[bytes]:
    total = 0
    for chunk in chunks:
        total += len(chunk)
        if total > most:
            raise too_large(name, total, most)
        yield chunk
