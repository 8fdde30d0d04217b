"""The tree as a whole: names, sizes, docstrings, who may import whom, and words that must not stand in it."""

from __future__ import annotations

import ast
import re
import statistics
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

REPO = Path(__file__).parent.parent
TOP = {
    *("dextera_build", "rules", "recipes", "cache", "examples", "tests"),
    *("pyproject.toml", "Makefile", "README.md", "LICENSE", "CHANGELOG.md"),
}
BANNED_STEMS = {"utils", "util", "helpers", "helper", "common", "misc", "manager"}
TEST_FOLDERS = {
    "benchmarks",
    "chaos",
    "docs",
    "e2e",
    "gpu",
    "hostile",
    "oracle",
    "packaging",
    "recipes",
    "robots",
    "rules",
}

FILE_LINES = 400
MEDIAN_FILE_LINES = 130
FUNCTION_LINES = 60
MOST_FUNCTION_LINES = 30

RULE_MAY_IMPORT = {
    *("rule", "artifacts", "formats", "previews", "geometry", "gaussians", "tracking"),
    *("sim", "policy", "learning", "statistics", "errors", "digest"),
}
LIGHT = {"numpy", "pydantic", "typing_extensions", "PIL", "yaml", *sys.stdlib_module_names}


def tracked() -> list[Path]:
    """Files that are, or will be, part of the project; without git (an unpacked sdist) all but caches."""
    command = ["git", "-C", str(REPO), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    if (REPO / ".git").exists():
        names = subprocess.run(command, capture_output=True, check=True, text=True).stdout.split("\0")
        return sorted(REPO / name for name in set(names) if name and (REPO / name).is_file())
    places = [REPO / name for name in TOP]
    inside = [path for place in places for path in ([place] if place.is_file() else place.rglob("*"))]
    return sorted(path for path in inside if path.is_file() and "__pycache__" not in path.parts)


FILES = tracked()
SOURCES = [p for p in FILES if p.suffix == ".py" and p.relative_to(REPO).parts[0] in {"dextera_build", "rules"}]
KNOWN = set(SOURCES)
TESTS = [p for p in FILES if p.suffix == ".py" and p.relative_to(REPO).parts[0] == "tests"]
RULES = [p for p in SOURCES if p.relative_to(REPO).parts[0] == "rules"]


def name(path: Path) -> str:
    """The path as messages show it."""
    return path.relative_to(REPO).as_posix()


@dataclass(frozen=True)
class Facts:
    """What the tests ask of a source file, so that it is parsed once for all of them."""

    is_described: bool
    functions: dict[str, int]
    """Place -> length in lines, decorators left out, of every function."""
    imports: dict[bool, tuple[tuple[int, str], ...]]
    """Whether only those at the top count -> (level, module); see `imports`."""


@cache
def facts(path: Path) -> Facts:
    tree = ast.parse(path.read_text())
    functions = {
        f"{name(path)}:{node.lineno} {node.name}": (node.end_lineno or node.lineno) - node.lineno + 1
        for node in _statements(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    imports = {top_only: tuple(_imports(tree, top_only)) for top_only in (False, True)}
    return Facts(bool(ast.get_docstring(tree)), functions, imports)


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """All below a node, without the expressions, which take most of the time to look through."""
    for part in _blocks(node):
        yield part
        yield from _statements(part)


def _blocks(node: ast.AST) -> Iterator[ast.AST]:
    for block in ("body", "orelse", "handlers", "finalbody", "cases"):
        yield from getattr(node, block, ())


def imports(path: Path, *, top_only: bool) -> tuple[tuple[int, str], ...]:
    """(level, module) of imports; `from . import a` gives (1, "a"). What only a type checker sees is left out."""
    return facts(path).imports[top_only]


def _imports(tree: ast.Module, top_only: bool) -> Iterator[tuple[int, str]]:
    stack: list[ast.AST] = list(tree.body)
    while stack:
        node = stack.pop()
        if isinstance(node, ast.Import):
            yield from ((0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from _from(node)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        elif not (top_only and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)):
            stack += _blocks(node)


def _from(node: ast.ImportFrom) -> Iterator[tuple[int, str]]:
    if node.module and (node.level or not node.module.startswith("dextera_build")):
        yield node.level, node.module
    else:
        prefix = f"{node.module}." if node.module else ""
        yield from ((node.level, prefix + alias.name) for alias in node.names)


def test_the_top_level_holds_only_the_known_names():
    found = {path.relative_to(REPO).parts[0] for path in FILES}
    assert {entry for entry in found if not entry.startswith(".")} - TOP == set()
    assert TOP - found == set()


def test_no_module_is_named_after_nothing():
    assert [
        name(path) for path in SOURCES + TESTS if path.stem in BANNED_STEMS or path.parent.name in BANNED_STEMS
    ] == []


def test_files_are_short():
    lines = {name(path): len(path.read_text().splitlines()) for path in SOURCES + TESTS}
    assert {place: count for place, count in lines.items() if count > FILE_LINES} == {}
    assert statistics.median(lines[name(path)] for path in SOURCES if path.name != "__init__.py") <= MEDIAN_FILE_LINES


@pytest.mark.medium
def test_functions_are_short():
    lengths = {place: length for path in SOURCES for place, length in facts(path).functions.items()}
    assert {place: count for place, count in lengths.items() if count > FUNCTION_LINES} == {}
    assert statistics.quantiles(lengths.values(), n=10)[-1] <= MOST_FUNCTION_LINES


def test_every_module_says_what_it_is_for():
    assert [name(path) for path in SOURCES if not facts(path).is_described] == []


def test_every_folder_of_tests_has_something_to_test():
    subjects = {path.name for path in (REPO / "dextera_build").iterdir() if path.is_dir()}
    folders = {path.relative_to(REPO / "tests").parts[0] for path in TESTS if path.parent != REPO / "tests"}
    assert folders - subjects - TEST_FOLDERS == set()


def test_every_stage_with_rules_has_tests():
    stages = {path.relative_to(REPO / "rules").parts[0] for path in RULES if "@rule(" in path.read_text()}
    tested = {path.relative_to(REPO / "tests" / "rules").parts[0] for path in TESTS if "rules" in path.parts}
    assert stages - tested == set()


def test_nothing_imports_rules():
    found = [(name(path), module) for path in SOURCES for level, module in imports(path, top_only=False) if not level]
    assert [pair for pair in found if pair[1].split(".")[0] in {"rules", "recipes"}] == []


def test_stages_do_not_import_one_another():
    assert [
        (name(path), module)
        for path in RULES
        for level, module in imports(path, top_only=False)
        if level >= len(path.relative_to(REPO / "rules").parts) and not _pools_tables(path, module)
    ] == []


def _pools_tables(path: Path, module: str) -> bool:
    """Whether rules of `benchmark` import from `evaluate`, whose tables they pool."""
    return path.relative_to(REPO / "rules").parts[0] == "benchmark" and module.startswith("evaluate")


def loaded(path: Path) -> Iterator[Path]:
    """Files beside a rule's file that it imports, those for a type checker alone included."""
    for node in _statements(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            yield from (base / f"{alias.name}.py" for alias in node.names if (base / f"{alias.name}.py").is_file())
            yield from [base.with_suffix(".py")] if node.module and base.with_suffix(".py").is_file() else []


@pytest.mark.medium
def test_rules_and_their_folders_import_in_no_circle():
    files = {path: set(loaded(path)) for path in RULES}
    folders: dict[Path, set[Path]] = {}
    for path, needed in files.items():
        for other in needed:
            if other.parent != path.parent and other.parent.parent == path.parent.parent:
                folders.setdefault(path.parent, set()).add(other.parent)
    assert len(list(TopologicalSorter(files).static_order())) == len(RULES)
    assert list(TopologicalSorter(folders).static_order())


def test_rules_import_only_what_is_below_them():
    found = [(name(path), module.split(".")) for path in RULES for _, module in imports(path, top_only=False)]
    ours = [(place, parts) for place, parts in found if parts[0] == "dextera_build"]
    assert [(place, ".".join(parts)) for place, parts in ours if parts[1] not in RULE_MAY_IMPORT] == []


@cache
def source(path: Path, level: int, module: str) -> Path | None:
    """The first-party file that an import loads, if it is one."""
    parts = module.split(".")
    base = path.parents[level - 1] if level else REPO
    for depth in range(len(parts), 0, -1):
        file = base.joinpath(*parts[:depth])
        for candidate in (file.with_suffix(".py"), file / "__init__.py"):
            if candidate in KNOWN:
                return candidate
    return None


def heavy(path: Path) -> Iterator[str]:
    """What importing a file would load beyond the light packages, through all first-party files that it imports."""
    seen, stack = {path}, [path]
    while stack:
        here = stack.pop()
        for level, module in imports(here, top_only=True):
            inside = source(here, level, module)
            if inside is not None and inside not in seen:
                seen.add(inside)
                stack.append(inside)
            elif inside is None and not level and module.split(".")[0] not in LIGHT:
                yield f"{name(here)} imports {module}"


def test_a_rule_file_imports_light_packages_only():
    files = [path for path in RULES if "@rule(" in path.read_text()]
    assert len(files) > 50
    assert {name(path): found for path in files if (found := list(heavy(path)))} == {}


TEXTS = [p for p in FILES if p.suffix in {".py", ".md", ".yaml", ".yml", ".toml", ".lock", ".sh", ".css", ".js", ""}]
MACHINE = re.compile(r"(?<![\w.])/(?:work|root|opt)/\w")
SCRATCH = re.compile(r"(?<![\w.])/tmp/\w")
# Written so that this line does not find itself.
REGISTRY = re.compile(r"pypi\.org|python" r"hosted\.org|deb\.debian\.org|npm" r"js\.org|\bfile:///|extra-index" r"-url")


@pytest.mark.parametrize("words", [MACHINE, REGISTRY], ids=["machine paths", "registries"])
def test_no_text_names_a_machine(words):
    found = [(name(path), match.group()) for path in TEXTS for match in words.finditer(path.read_text())]
    assert [pair for pair in found if pair[0] != "tests/test_tree.py"] == []


def test_pages_name_no_scratch_folder():
    pages = [path for path in FILES if path.suffix == ".md"]
    assert [(name(path), match.group()) for path in pages for match in SCRATCH.finditer(path.read_text())] == []
