"""Resolves imports of first-party modules by Python's rules, and reads their files.

First-party modules are those outside the standard library and the folders of installed distributions: `rules/`,
packages of a project anywhere on the module search path, and dxb itself.
"""

from __future__ import annotations

import errno
import json
import os
import pkgutil
import sys
import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.machinery import ModuleSpec
from pathlib import Path

from dextera_build import digest
from dextera_build.errors import MachineError, Place
from dextera_build.store import signature

PACKAGE = Path(__file__).parent.parent
DXB = "dextera_build"
_LIBRARY = os.path.dirname(os.path.realpath(os.__file__))
_INSTALLED = {"site-packages", "dist-packages"}
_BESIDE = {"PIL", "annotated_types", "numpy", "pydantic", "pydantic_core", "typing_extensions", "yaml"}
_KNOWN = sys.stdlib_module_names | _BESIDE
"""Top-level modules of Python and of packages that every installation of dxb has."""
_READ: dict[str, bytes] = {}
_PROOFS: dict[str, signature.Signature] = {}
"""Source file -> a signature that it has only as long as it holds what was read."""
_SHARED = "DEXTERA_SOURCES"


def read(file: str | os.PathLike[str]) -> bytes:
    """The bytes of a source file, cached on first read so that the digested and the executed bytes are the same.

    Raises:
        MachineError: It cannot be read.
    """
    name = os.fspath(file)
    if name not in _READ:
        try:
            _READ[name] = _noted(name)
        except OSError as error:
            raise MachineError(
                f"a source file cannot be read: {error.strerror}",
                code="DXB-E303",
                where=Place(name),
                hint="make it readable (`chmod u+r`), or delete it",
            ) from None
    return _READ[name]


def was_read(name: str) -> bool:
    """Whether this process read a source file of this name."""
    return name in _READ


def forget_changed() -> bool:
    """Drop cached sources whose files changed; returns whether there were any."""
    changed = [name for name, data in _READ.items() if not _is_proved(name) and _now(name) != data]
    for name in changed:
        del _READ[name]
    return bool(changed)


def _is_proved(name: str) -> bool:
    """Whether a file is as it was read, without reading it."""
    known = _PROOFS.get(name)
    return known is not None and signature.look(name) == known


def _now(name: str) -> bytes | None:
    with suppress(OSError):
        return _noted(name)
    return None


def _noted(name: str) -> bytes:
    """The bytes of a source file; its signature is kept if it proves later that they are the same."""
    _PROOFS.pop(name, None)
    looked_ns, found = time.time_ns(), signature.look(name)
    data = _bytes(name)
    if found is not None and signature.is_proof(found, looked_ns):
        _PROOFS[name] = found
    return data


def _bytes(name: str) -> bytes:
    place = on_disk(name)
    if place == name:
        return Path(name).read_bytes()
    from zipfile import BadZipFile, ZipFile

    try:
        with ZipFile(place) as archive:
            return archive.read(os.path.relpath(name, place))
    except (BadZipFile, KeyError):
        raise FileNotFoundError(errno.ENOENT, "it is not in its archive", name) from None


def on_disk(name: str) -> str:
    """The file itself, or the archive on the module search path that holds it."""
    above = () if os.path.exists(name) else Path(name).parents
    return next((str(place) for place in above if place.is_file()), name)


@contextmanager
def shared() -> Iterator[tuple[dict[str, str], Callable[[Iterable[Path]], None]]]:
    """Share sources as this process read them with workers on this machine, for the duration of the block.

    Yields:
        Environment variables for the workers, and a function to call once with the files whose sources it shares.
    """
    with os.fdopen(os.memfd_create("sources"), "w") as opened:

        def share(files: Iterable[Path]) -> None:
            json.dump({digest_of(data): data.decode("latin-1") for data in map(read, files)}, opened)  # any bytes
            opened.flush()

        yield {_SHARED: f"/proc/{os.getpid()}/fd/{opened.fileno()}"}, share


def earlier(wanted: str) -> bytes | None:
    """The source with this digest as read by this worker's build; None if unknown."""
    place = os.environ.get(_SHARED, "")
    if not os.path.isfile(place):  # the build has ended, and the descriptor may now be a pipe
        return None
    with suppress(OSError, ValueError), open(place) as opened:
        data: bytes = json.load(opened).get(wanted, "").encode("latin-1")
        return data if digest_of(data) == wanted else None
    return None


@cache
def digest_of(data: bytes) -> str:
    """Short digest of the bytes of a source file."""
    return digest.of_bytes(data)[:32]


def is_first_party(file: str) -> bool:
    """Whether a module's file belongs neither to the standard library nor to an installed distribution."""
    if not os.path.isabs(file):
        return False  # built in, or frozen
    return not file.startswith(_installed(tuple(sys.path)))


@lru_cache(maxsize=8)
def _installed(path: tuple[str, ...]) -> tuple[str, ...]:
    """Beginnings of the files of the standard library and of installed distributions.

    A folder called `site-packages` counts if modules are searched there; a project may lie below another one.
    """
    folders = [entry for entry in path if os.path.basename(entry.rstrip(os.sep)) in _INSTALLED]
    return tuple(f"{folder.rstrip(os.sep)}{os.sep}" for folder in (_LIBRARY, *folders))


@dataclass(frozen=True)
class Module:
    """The module that an import finds."""

    name: str
    """Import name."""
    file: Path | None
    """None for a package without a file."""
    search: tuple[str, ...] | None
    """Folders searched for submodules; None if it is not a package."""

    @property
    def package(self) -> str:
        """Package that relative imports in it start from."""
        return self.name if self.search is not None else self.name.rpartition(".")[0]


class Modules:
    """Looks up modules, each once, and records the searched places.

    Args:
        roots: Mounted package -> its folder; may grow later.
        own: Returns the top-level packages that are first-party even though they are installed.
    """

    def __init__(self, roots: Mapping[str, Path], own: Callable[[], Container[str]]) -> None:
        self._roots = roots
        self._found: dict[str, Module | None] = {DXB: Module(DXB, PACKAGE / "__init__.py", (str(PACKAGE),))}
        self._own = own
        self._foreign: set[str] = set()
        self.looked_at: set[str] = set()
        """Folders that were searched, and missing files that would take precedence."""

    def find(self, name: str) -> Module | None:
        """The module that `import name` finds; None if there is none or it is not first-party."""
        if name not in self._found:
            parent, _, tail = name.rpartition(".")
            self._found[name] = self._inner(name, tail, parent) if parent else self._top(name)
        return self._found[name]

    def is_foreign(self, top: str) -> bool:
        """Whether a top-level module exists but is not first-party."""
        self.find(top)
        return top in self._foreign

    def _inner(self, name: str, tail: str, parent: str) -> Module | None:
        above = self.find(parent)
        if above is None or above.search is None:
            return None
        self.looked_at.update(above.search)
        self.looked_at.update(os.path.join(folder, tail, "__init__.py") for folder in above.search)
        spec = _find_below(name, above.search)
        if spec is None:
            self.looked_at.update(os.path.join(folder, f"{tail}.py") for folder in above.search)
        return None if spec is None else _module(name, spec)

    def _top(self, name: str) -> Module | None:
        if name in self._roots:
            return Module(name, None, (str(self._roots[name]),))
        if name in sys.builtin_module_names:
            self._foreign.add(name)
            return None
        spec = find_top(name)
        if spec is None:
            return None
        found = _module(name, spec)
        places = [str(found.file)] if found.file else [os.path.join(folder, "_") for folder in found.search or ()]
        if all(is_first_party(place) for place in places) or (name not in _KNOWN and name in self._own()):
            return found
        self._foreign.add(name)
        return None


def _module(name: str, spec: ModuleSpec) -> Module:
    search = spec.submodule_search_locations
    file = Path(spec.origin) if spec.origin and spec.has_location else None
    return Module(name, file, None if search is None else tuple(search))


def find_top(name: str) -> ModuleSpec | None:
    """The spec of a top-level module from all finders except dxb's own."""
    for finder in sys.meta_path:
        if getattr(finder, "is_of_dxb", False) or not hasattr(finder, "find_spec"):
            continue
        spec: ModuleSpec | None = finder.find_spec(name, None)
        if spec is not None:
            return spec
    return None


def _find_below(name: str, search: Sequence[str]) -> ModuleSpec | None:
    """Like `PathFinder.find_spec`, but without importing the parent package."""
    folders: list[str] = []
    for entry in search:
        finder = pkgutil.get_importer(entry)
        spec = finder.find_spec(name) if finder is not None else None
        if spec is not None and spec.loader is not None:
            return spec
        folders += (spec.submodule_search_locations or []) if spec is not None else []
    if not folders:
        return None
    found = ModuleSpec(name, None, is_package=True)
    found.submodule_search_locations = folders
    return found
