"""Folders with installed models: `NAME/DIGEST/` holds the files, `NAME/DIGEST.json` the list of them.

The list is written last, so an interrupted installation leaves a version that does not count.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.errors import MachineError, Place
from dextera_build.models.model import Installed, ModelFile, digest_of
from dextera_build.store import disk_full, files

_LIST = ".json"
_LEAST = 12
"""Characters of a digest that name a folder."""

Progress = Callable[[str, int, int], None]
"""Called with the path of a file, the bytes done and all bytes."""


class ModelFolders:
    """Where models lie: the first folder receives new ones, the others are only read.

    Args:
        folders: Paths, existing or not.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self.folders = tuple(folders)

    def find(self, name: str, digest: str = "") -> Installed | None:
        """The version of a digest, or without one, the version installed last in the first folder that has any.

        Raises:
            MachineError: A list of files is damaged.
        """
        for folder in self.folders:
            found = [version for version in self.versions(folder, name) if digest in ("", version[1].digest)]
            if found:
                return max(found, key=lambda version: (version[0], version[1].digest))[1]
        return None

    def versions(self, folder: Path, name: str) -> Iterator[tuple[float, Installed]]:
        """Versions of a model in one folder with the times of their installation."""
        for listed in sorted((folder / name).glob(f"*{_LIST}")):
            with suppress(FileNotFoundError):  # removed meanwhile
                yield listed.stat().st_mtime, _read(name, listed)

    def all(self) -> Iterator[Installed]:
        """Every installed version in every folder."""
        for folder in self.folders:
            for inside in sorted(folder.glob("*/")):
                yield from (version for _, version in self.versions(folder, inside.name))

    def looked_at(self, name: str) -> Iterator[str]:
        """Files and folders, existing or not, that decide which version of a model is installed."""
        for folder in self.folders:
            yield from map(str, (folder, folder / name, *sorted((folder / name).glob(f"*{_LIST}"))))

    def install(self, name: str, fill: Callable[[Path], str], progress: Progress | None = None) -> Installed:
        """Install the files that `fill` writes into a folder.

        Args:
            name: The model's name.
            fill: Writes the files into the given folder, which may hold those of an interrupted call, and returns
                where they came from.
            progress: Told of the files as they are hashed.

        Raises:
            MachineError: The folder cannot be written, or is full, or `fill` wrote nothing.
        """
        home = self.folders[0] / name
        with _told(home), _alone(home):
            part = home / ".part"
            part.mkdir(exist_ok=True)
            source = fill(part)
            found = hashed(part, progress)
            if not found:
                raise MachineError(f"`{name}` has no files", code="DXB-E380", facts={"source": source})
            digest = digest_of(found)
            target = home / digest[:_LEAST]
            if target.exists():  # this version again, perhaps damaged
                shutil.rmtree(target)
            for file in found:
                os.chmod(part / file.path, 0o444)
            part.rename(target)
            document = {"digest": digest, "source": source, "files": [list(file) for file in found]}
            files.write(f"{target}{_LIST}", json.dumps(document, indent=1).encode(), 0o644)
            return Installed(name, digest, target, found, source)

    def remove(self, installed: Installed) -> None:
        """Remove one version."""
        with _told(installed.folder):
            os.unlink(f"{installed.folder}{_LIST}")
            shutil.rmtree(installed.folder)


def incomplete(installed: Installed) -> list[str]:
    """Files of a version that are absent, or have another size; nothing is read."""
    return [file.path for file in installed.files if _size(installed.folder / file.path) != file.size]


def damaged(installed: Installed, progress: Progress | None = None) -> list[str]:
    """Files of a version that are absent or have another content; every file is read."""
    told = progress or (lambda path, done, total: None)
    found, done, total = [], 0, installed.size
    for file in installed.files:
        path = installed.folder / file.path
        if _size(path) != file.size or digests.of_file(path) != file.sha256:
            found.append(file.path)
        done += file.size
        told(file.path, done, total)
    return found


def hashed(folder: Path, progress: Progress | None = None) -> tuple[ModelFile, ...]:
    """The files below a folder, without hidden ones."""
    told = progress or (lambda path, done, total: None)
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file() and not _is_hidden(path, folder)]
    sizes = [path.stat().st_size for path in paths]
    found, done, total = [], 0, sum(sizes)
    for path, size in zip(paths, sizes, strict=True):
        found.append(ModelFile(str(path.relative_to(folder)), size, digests.of_file(path)))
        done += size
        told(found[-1].path, done, total)
    return tuple(found)


def _is_hidden(path: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(folder).parts)


def _size(path: Path) -> int:
    with suppress(OSError):
        return path.stat().st_size
    return -1


def _read(name: str, listed: Path) -> Installed:
    try:
        document = json.loads(listed.read_bytes())
        found = tuple(ModelFile(str(path), int(size), str(sha256)) for path, size, sha256 in document["files"])
        digest, source = str(document["digest"]), str(document["source"])
    except (ValueError, TypeError, KeyError) as error:
        raise _damaged_list(listed) from error
    if digest_of(found) != digest or any(".." in Path(file.path).parts or file.path[:1] == "/" for file in found):
        raise _damaged_list(listed)
    return Installed(name, digest, listed.with_suffix(""), found, source)


def _damaged_list(listed: Path) -> MachineError:
    return MachineError(
        "the list of a model's files is damaged",
        code="DXB-E381",
        where=Place(str(listed)),
        hint="remove it, then `dxb models get` or `dxb models add` the model again",
    )


@contextmanager
def _alone(home: Path) -> Iterator[None]:
    """Hold the lock of a model: two installations would mix their files."""
    home.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(home / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _told(home: Path) -> Iterator[None]:
    """Turn a failed write into an error with a remedy."""
    try:
        yield
    except OSError as error:
        if error.errno is None:  # of a transfer, set by its source
            raise
        full = error.errno in disk_full.FULL
        raise MachineError(
            "no space is left for the model" if full else "the folder of models cannot be written",
            code="DXB-E382",
            facts={"folder": home, "system says": error.strerror},
            hint="set `models` in `dxb.toml`, or `DXB_MODELS`, to a folder "
            + ("on a larger disk" if full else "of yours"),
        ) from None
