"""What a rule's code is, for its key: the syntax trees of its file and of all first-party files it imports.

Comments, docstrings and positions are left out, so editing them rebuilds nothing. Digests are kept per top-level
definition, so that `dxb why` can name the function that changed.
"""

from __future__ import annotations

import ast
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dextera_build import digest

_YOUNG_S = 2.5
_PARSING = threading.Lock()
# What a rule writes against, and what can reach no artifact: the key's schema version stands for them.
_FRAMEWORK = ("__init__.py", "rule.py", "errors.py", "digest.py")

# What `@rule(...)` and `Backend(...)` say of how a call runs; it changes no result, so it stays out of the key.
_NEEDS = {"cpus", "memory_gb", "gpus", "resources", "retries", "retry_on", "retry_wait_s"}
_BACKEND_NEEDS = {"gpu_gb", "summary"}


def syntax(text: str, name: str = "<unknown>") -> ast.Module:
    """The syntax tree of the source of module file `name`.

    One thread at a time: Python 3.11 fails where two build trees at once.

    Raises:
        SyntaxError: It is no Python.
    """
    with _PARSING:
        return ast.parse(text, name)


def content(file: Path) -> str | None:
    """Digest of what a source file says, without comments, docstrings and positions; None where it cannot be read."""
    try:
        return _content(_parse(file))
    except (OSError, SyntaxError, ValueError):
        return None


def is_young(folder: Path) -> bool:
    """Whether a source file in `folder` was changed so lately that no byte code should be written for it.

    Python knows byte code by whole seconds and by size: what is made of a young file can outlive the next edit.
    """
    now = time.time()
    return any(file.stat().st_mtime > now - _YOUNG_S for file in folder.glob("*.py"))


@dataclass(frozen=True)
class _Source:
    definitions: dict[str, str]
    lines: dict[str, int]
    imports: tuple[tuple[int, str, tuple[str, ...]], ...]
    """(level, module, imported names) of every import statement that runs."""


class CodeIndex:
    """Digests of first-party source files, each parsed once.

    Args:
        roots: Mounted package -> folder of rule stages.
        package: The folder of dextera_build.
        project: The project's folder, whose own packages count as first-party too.
    """

    def __init__(self, roots: dict[str, Path], package: Path, project: Path | None) -> None:
        self._roots = roots
        self._package = package
        self._project = project
        self._framework = frozenset(package / name for name in _FRAMEWORK)
        self._parsed: dict[Path, _Source] = {}

    def of(self, *files: Path) -> dict[str, dict[str, str]]:
        """Source name -> definition -> digest, for `files` and all that they import, transitively."""
        todo, seen = list(files), set(files)
        while todo:
            for file in self._imported(todo.pop()):
                if file not in seen:
                    seen.add(file)
                    todo.append(file)
        return {self.name(file): self._source(file).definitions for file in sorted(seen)}

    def files(self) -> list[Path]:
        """Every file that was read so far."""
        return sorted(self._parsed)

    def contents(self) -> dict[Path, str]:
        """Digest of what each file says that was read so far, as `content` gives it."""
        return {file: _content(source) for file, source in self._parsed.items()}

    def name(self, file: Path) -> str:
        """The name of a source file that is the same on every machine: `rules/factorize/mesh.py`."""
        for folder in self._roots.values():
            if file.is_relative_to(folder):
                return f"rules/{file.relative_to(folder).as_posix()}"
        if file.is_relative_to(self._package):
            return f"dextera_build/{file.relative_to(self._package).as_posix()}"
        return file.relative_to(self._project).as_posix() if self._project else file.name

    def find(self, name: str, definition: str) -> tuple[Path, int] | None:
        """Where a definition of a named source stands now, or None where it is gone."""
        head, _, rest = name.partition("/")
        folders = {"rules": list(self._roots.values()), "dextera_build": [self._package]}.get(head, [])
        for file in [folder / rest for folder in folders] + ([self._project / name] if self._project else []):
            if file.is_file():
                return file, self._source(file).lines.get(definition, 1)
        return None

    def _imported(self, file: Path) -> Iterator[Path]:
        for level, module, names in self._source(file).imports:
            for base in self._bases(file, level, module):
                yield from (found for found in _modules(base, names) if found not in self._framework)

    def _bases(self, file: Path, level: int, module: str) -> list[Path]:
        parts = module.split(".") if module else []
        if level:
            folder = file.parents[level - 1]
            return [folder.joinpath(*parts)]
        if parts[0] == "dextera_build":
            return [self._package.joinpath(*parts[1:])]
        if self._project is not None and parts[0] not in ("rules", "tests"):
            return [self._project.joinpath(*parts)]
        return []

    def _source(self, file: Path) -> _Source:
        if file not in self._parsed:
            self._parsed[file] = _parse(file)
        return self._parsed[file]


def _content(source: _Source) -> str:
    return digest.of_value([list(source.definitions.items()), list(source.lines), source.imports])


def _modules(base: Path, names: tuple[str, ...]) -> Iterator[Path]:
    """Files that `import base` or `from base import names` runs, below first-party folders."""
    found = _file_of(base)
    if found is not None:
        yield found
    if found is None or found.name == "__init__.py":
        yield from (inner for name in names if (inner := _file_of(base / name)) is not None)


def _file_of(base: Path) -> Path | None:
    for file in (base.with_suffix(".py"), base / "__init__.py"):
        if file.is_file():
            return file
    return None


def _parse(file: Path) -> _Source:
    tree = syntax(file.read_text(), str(file))
    imports = tuple(_imports(tree))
    _strip_docstrings(tree)
    _strip_needs(tree)
    parts: dict[str, list[str]] = {}
    lines: dict[str, int] = {}
    for node in tree.body:
        name = _definition(node)
        parts.setdefault(name, []).append(ast.dump(node))
        lines.setdefault(name, getattr(node, "lineno", 1))
    return _Source({name: digest.of_value(dumps)[:16] for name, dumps in parts.items()}, lines, imports)


def _imports(tree: ast.Module) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    todo: list[ast.AST] = [tree]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import):
            yield from ((0, alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, node.module or "", tuple(alias.name for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            todo += node.orelse
        else:
            todo += ast.iter_child_nodes(node)


def _strip_docstrings(tree: ast.AST) -> None:
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [inner for inner in body if not _is_text(inner)]  # type: ignore[attr-defined]


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _definition(node: ast.stmt) -> str:
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return node.name
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    names = [target.id for target in targets if isinstance(target, ast.Name)]
    return names[0] if names else "<module>"


def _strip_needs(tree: ast.Module) -> None:
    for node in tree.body:
        marks = node.decorator_list if isinstance(node, ast.FunctionDef) else [getattr(node, "value", None)]
        for mark in marks:
            if isinstance(mark, ast.Call) and isinstance(mark.func, ast.Name):
                out = {"rule": _NEEDS, "Backend": _BACKEND_NEEDS}.get(mark.func.id, set())
                mark.keywords = [keyword for keyword in mark.keywords if keyword.arg not in out]
