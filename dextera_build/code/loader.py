"""Finds rules and backends by their path, imports them, and collects the code that enters their keys.

A rule `factorize.mesh` is the file `rules/factorize/mesh.py`, or `mesh.py` in a folder of that stage, in the first root
that has it: the project, installed distributions (entry-point group `dxb.rules`), dxb itself. Every root is mounted as
a package with a unique name, so no package called `rules` is ever installed or imported.
"""

from __future__ import annotations

import ast
import glob
import importlib
import importlib.machinery
import importlib.util
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from dextera_build import digest
from dextera_build.code.code_digest import RULES, Code, CodeIndex
from dextera_build.code.distributions import RUNTIME, entry_points, modules_of, normal, providers, version_of
from dextera_build.code.importer import IMPORTER, install, refused, watched
from dextera_build.code.machine import Machine
from dextera_build.code.modules import PACKAGE as PACKAGE
from dextera_build.code.modules import read
from dextera_build.code.renamed import renamed
from dextera_build.code.syntax import tree
from dextera_build.errors import Place, RecipeError, did_you_mean, listing

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from dextera_build.outside.program import Program
    from dextera_build.rule import Backend, Options, Rule


def bundled(kind: str) -> Path:
    """Folder of the `rules` or `recipes` bundled with dxb: inside the wheel, or next to the package in a checkout."""
    inside = PACKAGE / "_bundled" / kind
    return inside if inside.is_dir() else PACKAGE.parent / kind


class Root:
    """One folder of stages, mounted as a package once per process.

    The package is named after the folder, so libraries of several projects can coexist in one process.

    Args:
        path: The folder.
        base: Folder of environments and lock files of its programs; None: the parent folder.
    """

    def __init__(self, path: Path, base: Path | None = None) -> None:
        self.path = path
        self.base = base or path.parent
        self.name = f"dxb_rules_{digest.of_bytes(str(path).encode())[:12]}"
        install().roots[self.name] = path
        if self.name not in sys.modules:
            spec = importlib.machinery.ModuleSpec(self.name, None, is_package=True)
            spec.submodule_search_locations = [str(path)]
            sys.modules[self.name] = importlib.util.module_from_spec(spec)

    def module(self, file: Path) -> str:
        """Import name of a file below `path`."""
        return ".".join((self.name, *file.relative_to(self.path).with_suffix("").parts))

    def rules(self, stage: str, name: str) -> list[Path]:
        """Files in a stage and its folders that define a rule of this name; `*` matches any stage or name."""
        if not all(part == "*" or part.isidentifier() for part in (stage, name)):
            return []  # a path or another pattern
        patterns = (f"{stage}/{name}.py", f"{stage}/*/{name}.py")
        while True:
            with suppress(FileNotFoundError):  # a folder was removed while it was listed
                found = [file for pattern in patterns for file in self.path.glob(pattern)]
                return [file for file in sorted(found) if _line(file)]


@dataclass(frozen=True)
class RuleFile:
    """A rule as found on disk; imported on first access to `rule`."""

    path: str
    """`factorize.mesh`."""
    file: Path
    root: Root
    before: tuple[Root, ...] = ()
    """Roots that precede `root`; they may add backends."""

    @cached_property
    def rule(self) -> Rule[Any, Any]:
        """The imported rule.

        Raises:
            RecipeError: The file cannot be imported, or defines no rule of its own name and with types.
        """
        from dextera_build.code.typed import rule_of

        return rule_of(imported(self.root, self.path, self.file), self.path, self.place)

    @property
    def place(self) -> Place:
        """The line of the rule's function, for messages."""
        return Place(str(self.file), _line(self.file))

    @cached_property
    def backends(self) -> dict[str, BackendFile]:
        """Backends by name, read without importing them; of two with one name, that of the earlier root."""
        found: dict[str, BackendFile] = {}
        for root, file in self.candidates:
            facts = _backend_facts(file)
            if facts is not None:
                name = file.stem.removeprefix(f"{self.file.stem}_")
                found.setdefault(name, BackendFile(name, file, root, self.path, facts))
        return dict(sorted(found.items()))

    @cached_property
    def candidates(self) -> list[tuple[Root, Path]]:
        """Files that are backends if they define `BACKEND`: next to the rule, or in its stage in an earlier root."""
        pattern, stage = f"{self.file.stem}_*.py", self.path.partition(".")[0]
        found = [
            (root, file)
            for root in self.before
            for inner in (pattern, f"*/{pattern}")
            for file in sorted((root.path / stage).glob(inner))
        ]
        return [*found, *((self.root, file) for file in sorted(self.file.parent.glob(pattern)))]


@dataclass(frozen=True)
class BackendFile:
    """A backend as found on disk."""

    name: str
    file: Path
    root: Root
    rule: str
    """Path of its rule."""
    facts: Backend

    @cached_property
    def module(self) -> ModuleType:
        """The imported module."""
        return imported(self.root, f"{self.rule.partition('.')[0]}.{self.file.stem}", self.file)

    @cached_property
    def options(self) -> type[Options] | None:
        """Its own options: the type of the parameter `options` of its functions; None if it has none.

        Raises:
            RecipeError: The file cannot be imported, or its functions take different classes.
        """
        annotated = _annotations_of_options(self.file) - {"Options"}
        if not annotated:
            return None  # known without importing the file, which may load heavy packages
        kinds = [vars(self.module).get(name) for name in annotated]
        if len(kinds) > 1 or kinds[0] is None:
            raise RecipeError(
                f"the functions of backend `{self.name}` of {self.rule} take no one class of options",
                code="DXB-R212",
                where=Place(str(self.file)),
                facts={"types of `options`": listing(sorted(annotated))},
                hint="define one class derived from `Options` in that file",
            )
        own: type[Options] = kinds[0]
        return own

    @cached_property
    def program(self) -> Program | None:
        """Its program, if it declares one."""
        facts = self.facts
        if not facts.command:
            return None
        from dextera_build.outside.program import Program
        from dextera_build.outside.running import Limits

        return Program(
            backend=f"{self.name} of {self.rule}",
            file=self.file,
            base=self.root.base,
            command=facts.command,
            files=facts.files,
            environment=facts.environment,
            lock=facts.lock,
            server=facts.server,
            limits=Limits(facts.timeout_s, facts.memory_gb, facts.disk_gb),
        )

    def missing(self) -> list[str]:
        """Required distributions that are not installed."""
        return [name for name in self.facts.packages if version_of(name) is None]

    def lacks(self, machine: Machine) -> dict[str, str]:
        """Requirements that the machine lacks -> the next step; see `Machine.lacks`."""
        return machine.lacks(self.facts, self.missing()) | (self.program.lacking() if self.program else {})


class Library:
    """All rules that a project can use.

    Args:
        project: The project's folder; its `rules/` comes first.
        machine: Has the weights and devices that backends need; None for a machine without any.
    """

    def __init__(self, project: Path | None = None, machine: Machine | None = None) -> None:
        self.project = project or Path.cwd()
        self.machine = machine or Machine()
        self._project = project
        folder = project / RULES if project else None
        # Links stay in the path, so that every look follows them as they lead now.
        self._first = [Root(folder.absolute())] if folder and folder.is_dir() else []
        """The project's own root, if it has one."""
        self._found: dict[str, RuleFile] = {}
        self.asked: set[str] = set()
        """Companions that were looked for, missing ones included."""
        self.warnings: dict[str, str] = {}
        """Warnings by what they are about: modules whose versions are in no key, settings that nothing reads."""
        self.since_ns = time.time_ns()
        """No source was read before [ns since the epoch], but those that are as they were."""
        IMPORTER.forget_changed()

    @cached_property
    def roots(self) -> list[Root]:
        """Roots searched for rules, in order."""
        folders = [
            Path(str(importlib.util.find_spec(point.value).submodule_search_locations[0]))  # type: ignore[union-attr,index]
            for point in self._points
        ]
        folders.append(bundled(RULES).resolve())
        own = {root.path.resolve() for root in self._first}
        others = [folder for folder in dict.fromkeys(folders) if folder.resolve() not in own]
        return [*self._first, *(Root(folder, self.project) for folder in others)]

    @cached_property
    def _points(self) -> Sequence[EntryPoint]:
        """Entry points of installed distributions that provide rules."""
        return entry_points("dxb.rules")

    def find(self, path: str, where: Place | None = None) -> RuleFile:
        """The rule called `path`.

        Raises:
            RecipeError: No root has it.
        """
        if path not in self._found:
            # The project's own rules are found without searching installed distributions.
            found = _among(self._first, path) or _among(self.roots, path)
            if found is None:
                raise renamed(path, where) or self._unknown(path, where)
            self._found[path] = found
        return self._found[path]

    def rules(self) -> Iterator[RuleFile]:
        """Every rule, by path; files without `@rule` (helpers, backends) are left out."""
        seen = set()
        for root in self.roots:
            for file in root.rules("*", "*"):
                path = f"{file.relative_to(root.path).parts[0]}.{file.stem}"
                if path not in seen:
                    seen.add(path)
                    yield self.find(path)

    def packages(self, found: RuleFile, code: Code, declared: Iterable[str]) -> dict[str, str | None]:
        """Distribution -> version (None: not installed) of the imports and declarations of a rule, and of `RUNTIME`.

        A module that no distribution is known to have is added to `warnings`: its version is in no key.

        Args:
            found: The rule.
            code: The code of the rule and its backend.
            declared: Distributions that the rule or its backend declares.
        """
        having = providers(code.foreign.keys() - sys.stdlib_module_names)
        names = {*RUNTIME, *map(normal, declared), *(name for each in having.values() for name in each)}
        unseen = {top for top in having if not having[top]}
        if unseen:
            unseen -= {top for name in declared for top in (normal(name).replace("-", "_"), *modules_of(name))}
        for top in sorted(unseen):
            self.warnings[top] = (
                f"{found.path} imports `{top}`, which is neither code of the project nor of an installed distribution: "
                "another version of it makes nothing stale; install it as a distribution, or name the one that has it "
                f"in `packages` ({code.foreign[top]})"
            )
        return {name: self._version(name) for name in sorted(names)}

    @cached_property
    def _version(self) -> Callable[[str], str | None]:
        """`version_of`, asked once for each distribution."""
        return cache(version_of)

    def place_of(self, source: str, definition: str) -> tuple[Path, int] | None:
        """The file and line of a definition in a named source, or None if the source is gone."""
        return self.code.find(source, definition, [root.path for root in self.roots])

    def looked_at(self) -> set[str]:
        """Files and folders, including missing ones, that determine the code of the rules found so far."""
        found = self.code.looked_at() | self.machine.models.looked_at() | self.asked
        if self._project is not None:
            found.add(str(self._project / RULES))
        for path, rule in self._found.items():
            stage, _, name = path.partition(".")
            found.update(str(file) for _, file in rule.candidates)
            for backend in rule.backends.values():
                found |= backend.program.looked_at() if backend.program else set()
            roots = self._first if rule.root in self._first else self.roots
            for root in roots[: roots.index(rule.root) + 1]:
                folder = root.path / stage
                # A new file in one of these may be the rule or one of its backends.
                inner = (place for place in folder.glob("*") if place.name != "__pycache__" and place.is_dir())
                found.update(map(str, (root.path, folder, folder / f"{name}.py", *inner)))
        return found

    @cached_property
    def code(self) -> CodeIndex:
        """Code digests of the files in the roots, of dxb and of the project's own packages."""
        return CodeIndex(IMPORTER.roots, lambda: {point.value.partition(".")[0] for point in self._points})

    def _unknown(self, path: str, where: Place | None) -> RecipeError:
        stage = path.partition(".")[0]
        known = [found.path for found in self.rules()]
        same = [rule for rule in known if rule.startswith(f"{stage}.")]
        return RecipeError(
            f"no rule is called `{path}`",
            code="DXB-R201",
            where=where,
            facts={f"rules of `{stage}`" if same else "rules": listing(same or known, most=40)},
            hint=did_you_mean(path, known) or "`dxb ls rules` shows all of them",
        )


def _among(roots: Sequence[Root], path: str) -> RuleFile | None:
    stage, dot, name = path.partition(".")
    for root in roots:
        found = root.rules(glob.escape(stage), glob.escape(name)) if dot else []
        if len(found) > 1:
            raise RecipeError(
                f"two files hold the rule `{path}`",
                code="DXB-R208",
                facts={"files": listing(str(file.relative_to(root.path)) for file in found)},
                hint="rename one of them, with its function",
            )
        if found:
            return RuleFile(path, found[0], root, tuple(roots[: roots.index(root)]))
    return None


def imported(root: Root | None, path: str, file: Path) -> ModuleType:
    """The module of a file in a root, or in dxb itself, which messages call `path`."""
    own = () if root else file.relative_to(PACKAGE.parent).with_suffix("").parts
    try:
        with watched(path, file):
            return importlib.import_module(root.module(file) if root else ".".join(own))
    except Exception as error:
        raise refused(path, file, error) from error


def _line(file: Path) -> int:
    """Line of the `@rule` function named after the file; 0 if there is none."""
    text = read(file).decode(errors="replace")
    found = re.search(rf"^@rule\(.*?^def {file.stem}\b", text, re.MULTILINE | re.DOTALL)
    return text.count("\n", 0, found.end()) + 1 if found else 0


def _annotations_of_options(file: Path) -> set[str]:
    """Types of the parameter `options` of the public functions `f(ctx, ..., options)` of a file, as written."""
    found = set()
    for node in tree(read(file), str(file)).body:
        if not isinstance(node, ast.FunctionDef) or node.name.startswith("_") or len(node.args.args) < 2:
            continue
        first, last = node.args.args[0], node.args.args[-1]
        if (first.arg, last.arg) == ("ctx", "options") and last.annotation is not None:
            found.add(ast.unparse(last.annotation))
    return found


def _backend_facts(file: Path) -> Backend | None:
    from dextera_build.rule import Backend

    for node in tree(read(file), str(file)).body:
        if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)):
            continue
        if not any(isinstance(target, ast.Name) and target.id == "BACKEND" for target in node.targets):
            continue
        try:
            return Backend(**{str(word.arg): ast.literal_eval(word.value) for word in node.value.keywords})
        except (ValueError, TypeError) as error:
            where = Place(str(file), node.lineno)
            raise RecipeError(
                f"`BACKEND` must be `Backend(...)` with literal arguments: {error}", code="DXB-R207", where=where
            ) from None
    return None
