"""Digests a rule's code for its key: the syntax trees of its file and of all first-party files it imports."""

from __future__ import annotations

import os
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from dextera_build.code import syntax
from dextera_build.code.modules import DXB, PACKAGE, Module, Modules, digest_of, on_disk, read
from dextera_build.code.order import ORDER
from dextera_build.code.parsed import Parsed
from dextera_build.store.state import State

# Modules that rules are written against but that cannot affect artifacts; the key's schema version covers them.
_INTERFACE = ("__init__", "backend", "context", "declaration", "options")
_FRAMEWORK = frozenset(
    PACKAGE / name for name in ("__init__.py", "errors.py", "digest.py", *(f"rule/{part}.py" for part in _INTERFACE))
)
RULES = "rules"
"""Placeholder for the root of a rule in names of sources; `rules+2`, ... for those of its backend and companions."""
EXCHANGE = PACKAGE / "formats" / "exchange.py"
"""Forms of values outside; part of the code of every backend with a program."""
FILE = "<file>"
"""The one definition of a file that is digested byte by byte: of a program, or a lock file."""
_OF_DXB = f"{PACKAGE}{os.sep}"
_SOURCE = ".py"
_PACKAGE = "__init__.py"


@dataclass(frozen=True)
class Code:
    """The first-party code of a rule and its backend."""

    definitions: Mapping[str, Mapping[str, str]]
    """Source -> top-level definition, or `<module>` -> digest, and `ORDER` -> names; part of the key."""
    sources: Mapping[str, str]
    """Source -> digest of its bytes, checked by workers; "" for one that was looked for but does not exist."""
    foreign: Mapping[str, Path]
    """Top-level module that is not first-party -> a file that imports it."""


class CodeIndex:
    """Digests of first-party source files, each read and parsed once.

    Args:
        roots: Mounted package -> folder of rule stages; may grow later.
        own: Returns the top-level packages that are first-party even though they are installed.
    """

    def __init__(self, roots: Mapping[str, Path], own: Callable[[], Container[str]]) -> None:
        self._roots = roots
        self._modules = Modules(roots, own)
        self._parsed: dict[Path, syntax.Source] = {}
        self._parse: Callable[[bytes, str], syntax.Source] = syntax.source
        self._named: dict[str, Path] = {}
        self._imports: dict[str, tuple[str, ...]] = {}
        self._foreign: dict[Path, set[str]] = {}

    @contextmanager
    def kept_in(self, state: State) -> Iterator[None]:
        """In the block, take sources that earlier commands parsed from a store's state, and add those that it lacks."""
        parsed = Parsed(state)
        self._parse = parsed.source
        try:
            yield
        finally:
            self._parse = syntax.source
            parsed.save()

    def of(self, *files: Path) -> Code:
        """The code of `files` and of all first-party modules they import, transitively.

        Roots are named in the order of `files`, the first one `RULES`.
        """
        heads = {root: _head(number) for number, root in enumerate(self._roots_of(files), 1)}
        definitions, sources, foreign = dict[str, dict[str, str]](), dict[str, str](), dict[str, Path]()
        modules = list(self._closure(files))
        every = any(self._lists_names(module) for _, module in modules)
        for name, module in modules:
            if module is None or module.file is None:
                sources[_spelled(name, heads) + (_SOURCE if module is None else f"/{_PACKAGE}")] = ""
                continue
            source = self._name(module, heads)
            parsed = self._source(module.file)
            definitions[source] = parsed.definitions | ({ORDER: parsed.sequence} if every else {})
            sources[source] = digest_of(read(module.file))
            foreign |= dict.fromkeys(self._foreign.get(module.file, ()), module.file)
        return Code(*(dict(sorted(found.items())) for found in (definitions, sources, foreign)))  # type: ignore[arg-type]

    def _lists_names(self, module: Module | None) -> bool:
        """Whether a module may see in which order another one binds its names; none of dxb's asks for it."""
        file = module.file if module else None
        return file is not None and not str(file).startswith(_OF_DXB) and self._source(file).lists_names

    def looked_at(self) -> set[str]:
        """Files that were read, folders that were searched, and missing files that would take precedence."""
        return {*map(on_disk, map(str, self._parsed)), *self._modules.looked_at}

    def files(self) -> list[Path]:
        """The source files that were read so far."""
        return list(self._parsed)

    def find(self, name: str, definition: str, roots: Sequence[Path]) -> tuple[Path, int] | None:
        """The file and line of a definition in a named source, or None if the source is gone.

        Args:
            name: The source.
            definition: Name of a top-level definition in it.
            roots: Folders of rule stages, in order.
        """
        head, _, rest = name.partition("/")
        folders = {RULES: roots, DXB: [PACKAGE]}.get(head.partition("+")[0], [])
        known = [self._named[name]] if name in self._named else []
        if not (known or folders):  # the plan is that of an earlier command
            module = self._modules.find(module_of(name))
            known = [module.file] if module and module.file else []
        for file in [*known, *(folder / rest for folder in folders)]:
            if file.is_file():
                return file, 1 if definition == FILE else self._source(file).lines.get(definition, 1)
        return None

    def _closure(self, files: Iterable[Path]) -> Iterator[tuple[str, Module | None]]:
        """Modules of `files` and of everything they import, by name; None for a module that does not exist."""
        todo = [self._module_name(file) for file in files]
        seen = set(todo)
        while todo:
            name = todo.pop()
            module = self._modules.find(name)
            if name in self._roots or (module is not None and module.file in _FRAMEWORK):
                continue
            yield name, module
            if module is None:
                continue
            fresh = [inner for inner in self._imported(module) if inner not in seen]
            seen.update(fresh)
            todo += fresh

    def _module_name(self, file: Path) -> str:
        # A process may have mounted the roots of many projects, and `is_relative_to` takes long.
        for name, folder in self._roots.items():
            if str(file).startswith(f"{folder}{os.sep}"):
                return ".".join((name, *file.relative_to(folder).with_suffix("").parts))
        if file.is_relative_to(PACKAGE):
            return ".".join((DXB, *file.relative_to(PACKAGE).with_suffix("").parts))
        raise ValueError(file)

    def _imported(self, module: Module) -> tuple[str, ...]:
        if module.name not in self._imports:
            # Parent packages run first.
            names = dict.fromkeys(_prefixes(module.name))
            for level, base, inner in self._source(module.file).imports if module.file else ():
                for name in self._asked(module, level, base, inner):
                    names.update(dict.fromkeys(_prefixes(name)))
            self._imports[module.name] = tuple(names)
        return self._imports[module.name]

    def _asked(self, module: Module, level: int, base: str, names: tuple[str, ...]) -> Iterator[str]:
        """Names of the modules that an import statement in `module` looks for."""
        if level:
            above = module.package.split(".")
            base = ".".join([*above[: max(0, len(above) - level + 1)], *([base] if base else [])])
        if not base:
            return  # it leads out of the root, which Python refuses
        top = base.partition(".")[0]
        if self._modules.is_foreign(top):
            if module.file:
                self._foreign.setdefault(module.file, set()).add(top)
            return
        yield base
        found = self._modules.find(base)
        if found is not None and found.search is not None:
            listed = self._source(found.file).exports if "*" in names and found.file else ()
            yield from (f"{base}.{name}" for name in (*names, *listed) if name != "*")

    def _roots_of(self, files: Iterable[Path]) -> Iterable[str]:
        """The roots of files, each once, in their order."""
        tops = [self._module_name(file).partition(".")[0] for file in files]
        return dict.fromkeys(top for top in tops if top in self._roots)

    def _name(self, module: Module, heads: Mapping[str, str]) -> str:
        """Name of a source file, equal on every machine: `rules/factorize/mesh.py`."""
        assert module.file is not None
        inside = f"/{_PACKAGE}" if module.search is not None else module.file.suffix
        name = f"{_spelled(module.name, heads)}{inside}"
        self._named[name] = module.file
        return name

    def _source(self, file: Path) -> syntax.Source:
        if file not in self._parsed:
            data, is_text = read(file), file.suffix == _SOURCE
            parsed = self._parse(data, str(file)) if is_text else syntax.Source({"<binary>": digest_of(data)}, {}, ())
            self._parsed[file] = parsed
        return self._parsed[file]


def _spelled(name: str, heads: Mapping[str, str]) -> str:
    top, _, rest = name.partition(".")
    return f"{heads.get(top, top)}/{rest}".replace(".", "/").rstrip("/")


def _head(number: int) -> str:
    return RULES if number == 1 else f"{RULES}+{number}"


def module_of(source: str, roots: Sequence[str] = (RULES,)) -> str:
    """Import name of a named source; `roots` are the packages under which the roots of its rule are mounted."""
    end = f"/{_PACKAGE}"
    stem = source.removesuffix(end) if source.endswith(end) else source.rpartition(".")[0]
    top, *rest = stem.split("/")
    head, _, number = top.partition("+")
    return ".".join([roots[int(number or 1) - 1] if head == RULES else top, *rest])


def _prefixes(name: str) -> Iterator[str]:
    """`a`, `a.b` and `a.b.c` for `a.b.c`, in import order."""
    parts = name.split(".")
    return (".".join(parts[: count + 1]) for count in range(len(parts)))
