"""Imports first-party modules from the digested source; their byte code is neither read nor written.

In the planning process, a module is compiled from the bytes that `modules.read` keeps for the digest. A worker gets
the source digests of the key with each task and runs exactly these sources; it refuses if it cannot get them.
"""

from __future__ import annotations

import linecache
import os
import re
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import NoReturn

from dextera_build.code.children import Children
from dextera_build.code.code_digest import module_of
from dextera_build.code.modules import DXB, PACKAGE, digest_of, earlier, find_top, forget_changed, is_first_party, read
from dextera_build.code.syntax import too_deep
from dextera_build.errors import DxbError, MachineError, Place, RecipeError, RuleError
from dextera_build.store import signature

_ROOMS = ("artifacts", "formats", "gaussians", "geometry", "learning", "policy", "previews", "sim", "tracking")
_DIGESTED = tuple(f"{DXB}.{name}" for name in _ROOMS)
"""Packages of dxb that are digested into the keys of rules."""
_PACKAGE = "/__init__.py"


class Importer:
    """A finder for Python's import system, one per process."""

    is_of_dxb = True

    def __init__(self) -> None:
        self.roots: dict[str, Path] = {}
        """Packages under which rules are mounted -> their folders."""
        self.takes_dxb = False
        """Whether dxb's own modules are compiled from source as well."""
        self.children: Children | None = None
        """Of a worker: the data for the processes that it starts."""
        self._wanted: dict[str, str] = {}
        self._loaded: dict[str, str] = {}
        """Module -> digest of its source; "" for one that has none: missing, or a package without `__init__.py`."""
        self._origins: dict[str, tuple[Sequence[str] | None, str]] = {}
        """Module -> the folders that were searched for it, None for the search path, and the file found there."""
        self._found_in: dict[str, tuple[tuple[str, signature.Signature | None], ...]] = {}
        """Module -> signatures of folders that prove later that an import finds the same file."""
        self._edited: RuleError | None = None

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Part of Python's import system."""
        wanted = self._wanted.get(name)
        if wanted == "":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        top = name.partition(".")[0]
        may_be_ours = (
            self.takes_dxb and name.startswith(_DIGESTED) if top == DXB else top not in sys.stdlib_module_names
        )
        if not (wanted or may_be_ours):
            return None
        spec = _search(name, path)
        file = _file(spec)
        if wanted is not None and bool(file) == (wanted == _PACKAGE):
            raise self._refuse(file or name)
        if not file and all(map(is_first_party, path or ())):
            self._loaded[name] = ""
            self._origins[name] = path, file
        if spec is not None and type(spec.loader) is SourceFileLoader and self._is_ours(name, spec.loader.path):
            spec.loader = _Loader(name, spec.loader.path, self)
            self._origins[name] = path, file
        return spec

    def want(self, sources: Mapping[str, str], roots: Sequence[str]) -> None:
        """Set the sources from which the code of a task was digested.

        Args:
            sources: See `code_digest.Code`.
            roots: The packages under which the roots of its code are mounted, that of its rule first.

        Raises:
            RuleError: One of its modules was already loaded from another source, or found missing, or its roots differ.
        """
        self._edited = None
        for source, said in sources.items():
            try:
                name = module_of(source, roots)
            except IndexError:  # a rule that was found in another root here
                raise self._refuse(source) from None
            self._wanted[name] = said or (_PACKAGE if source.endswith(_PACKAGE) else "")
            if self._loaded.get(name, said) != said:
                raise self._refuse(self._origins[name][1] or source)
        if self.children is not None:
            self.children.tell(self._wanted)

    def verify(self) -> None:
        """Raise the error of a refused import again, even if the rule caught it.

        Raises:
            RuleError: A module differs from the digested one.
        """
        if self.children is not None and (name := self.children.refused()):
            self._refuse(self._origins.get(name, (None, name))[1])
        if self._edited is not None:
            raise self._edited

    def source(self, name: str, file: str) -> bytes:
        """The source of a module as digested, even if the file was edited since.

        Raises:
            RuleError: It was edited, and the digested source is not available here.
        """
        data, wanted = read(file), self._wanted.get(name)
        if wanted is not None and wanted != digest_of(data):
            known = earlier(wanted)
            if known is None:
                raise self._refuse(file)
            data = known
        self._loaded[name] = digest_of(data)
        return data

    def forget_changed(self) -> None:
        """Forget all loaded modules if a source file changed, appeared or vanished."""
        invalidate_caches()  # Python caches the contents of folders on the search path
        began_ns, look = time.time_ns(), cache(signature.look)
        if forget_changed() or any(self._is_elsewhere(name, look, began_ns) for name in self._origins):
            for name in self._loaded:
                sys.modules.pop(name, None)
            self._loaded.clear()
            self._origins.clear()
            self._found_in.clear()

    def _is_elsewhere(self, name: str, look: Callable[[str], signature.Signature | None], began_ns: int) -> bool:
        """Whether an import would find another file than the loaded one; searched only if a folder may have changed."""
        path, file = self._origins[name]
        try:
            places = [place or os.getcwd() for place in (sys.path if path is None else path)]
            # A folder of the module's name may become a package.
            inside = [os.path.join(place, name.rpartition(".")[2]) for place in places]
            state = tuple((place, look(place)) for place in (*places, *inside))
            if self._found_in.get(name) == state:
                return False
            is_elsewhere = _file(_search(name, path)) != file
        except KeyError:  # the path of a namespace package, whose parent failed to load
            return True
        if not is_elsewhere and all(seen is None or signature.is_proof(seen, began_ns) for _, seen in state):
            self._found_in[name] = state
        return is_elsewhere

    def _refuse(self, file: str) -> RuleError:
        self._edited = RuleError(
            "code differs from that in this node's key: it was edited while the build ran, or is another version",
            code="DXB-B315",
            where=Place(file),
            hint="build again; on a cluster, install the same version of dxb on every machine",
        )
        return self._edited

    def _is_ours(self, name: str, file: str) -> bool:
        top = name.partition(".")[0]
        return top == DXB or top in self.roots or name in self._wanted or is_first_party(file)


class _Loader(SourceFileLoader):
    """Compiles a module from source."""

    def __init__(self, name: str, path: str, importer: Importer) -> None:
        super().__init__(name, path)
        self._importer = importer

    def get_code(self, fullname: str) -> CodeType:
        """The module's code, compiled without the byte-code cache of the base class."""
        try:
            code: CodeType = self.source_to_code(self._importer.source(fullname, self.path), self.path)
        except (RecursionError, MemoryError):  # the parser's stack, or the compiler's
            raise too_deep(self.path) from None
        return code


def _search(name: str, path: Sequence[str] | None) -> ModuleSpec | None:
    return find_top(name) if path is None else PathFinder.find_spec(name, path)


def _file(spec: ModuleSpec | None) -> str:
    """The file of a module; "" if it has none."""
    return str(spec.origin) if spec is not None and spec.has_location else ""


IMPORTER = Importer()


def install() -> Importer:
    """Install `IMPORTER` for first-party modules."""
    if IMPORTER not in sys.meta_path:
        # Insert directly before Python's own finder: earlier finders, such as that of pytest, keep their place.
        place = sys.meta_path.index(PathFinder) if PathFinder in sys.meta_path else 0
        sys.meta_path.insert(place, IMPORTER)
    return IMPORTER


@contextmanager
def watched(path: str, file: Path) -> Iterator[None]:
    """Keep a module imported in the block from ending the process.

    Raises:
        RecipeError: It tried to end the process.
    """
    leave, here = os._exit, os.getpid()

    def ended(status: int) -> NoReturn:
        if os.getpid() != here:  # a forked child may exit
            leave(status)
        raise SystemExit(status)

    os._exit = ended
    try:
        yield
    except SystemExit as error:
        raise RecipeError(
            f"{path} ends the process while it is imported",
            code="DXB-R211",
            where=Place(str(file)),
            facts={"exit code": str(error.code)},
            hint="raise an error in the rule's function instead",
        ) from None
    finally:
        os._exit = leave


def refused(path: str, file: Path, error: Exception) -> DxbError:
    """The error for a failed import."""
    if isinstance(error, DxbError):
        return error
    if isinstance(error, SyntaxError):
        where = Place(error.filename or str(file), error.lineno or 0, error.offset or 0)
        return RecipeError(f"{path} is not valid Python: {error.msg}", code="DXB-R206", where=where)
    package = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if package and not package.startswith("dxb_rules") and find_top(package) is None:
        return MachineError(
            f"{path} needs the package `{package}`, which is not installed",
            code="DXB-E302",
            where=Place(str(file)),
            facts={"Python": sys.executable},
            hint="install it; code of the project itself needs `pip install -e .`, or its folder on PYTHONPATH",
        )
    said = str(error) if isinstance(error, ImportError) else f"{type(error).__name__}: {error}"
    said = re.sub(r"\bdxb_rules_[0-9a-f]{12}\b", "rules", said)
    where = _last(error, file)
    hint = _place_of_types(where) if isinstance(error, ImportError) else None
    return RecipeError(f"{path} cannot be imported: {said}", code="DXB-R205", where=where, hint=hint)


def _place_of_types(where: Place) -> str | None:
    """The right import for a line that looks for artifact types in another module of `dextera_build.artifacts`."""
    module, _, names = linecache.getline(where.file, where.line).partition(" import ")
    if not module.startswith("from dextera_build.artifacts"):
        return None
    files = sorted((PACKAGE / "artifacts").rglob("*.py"))
    found = [
        f"`from {DXB}.{'.'.join(file.relative_to(PACKAGE).with_suffix('').parts)} import {name}`"
        for name in re.findall(r"\w+", names)
        for file in files
        if re.search(rf"^class {name}\b", file.read_text(), re.MULTILINE)
    ]
    return ", ".join(found) or None


def _last(error: Exception, file: Path) -> Place:
    """The innermost line of first-party code in the traceback of an exception."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if is_first_party(frame.filename) and not frame.filename.startswith(str(PACKAGE))]
    return Place(own[-1].filename, own[-1].lineno or 0) if own else Place(str(file))
