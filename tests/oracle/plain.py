"""A clean build of a random project by plain Python: no keys, no store, no byte code, no importer but Python's own."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import re
import site
import sys
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import yaml

from dextera_build.artifacts.base import File, Folder
from dextera_build.code import loader
from tests.chaos.children import Said, Workers, pool, start
from tests.oracle.projects import PLUG, RECIPES, STAGE, RandomProject

RECIPE = "deep/g"
QUIET = ("--console", "none")


def start_in(root: Path, *, writes: bool = True) -> None:
    """Be a Python that starts where the packages of a project are on the search path; it may write byte code."""
    sys.dont_write_bytecode = not writes
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.path[:0] = [str(root / "first"), str(root / "src")]
    site.addsitedir(str(root / "site"))
    importlib.invalidate_caches()
    real = loader.bundled
    loader.bundled = lambda kind: root / "bundled/recipes" if kind == "recipes" else real(kind)


def build(
    project: RandomProject, *words: str, begin: Callable[[], object] = lambda: None, workers: bool = False
) -> Said:
    """Run `dxb build` on a project in a process of its own.

    Args:
        project: What is built.
        words: More words of the command line.
        begin: Called in that process before the command.
        workers: Nodes run in workers.
    """
    return started(project, *words, begin=begin, workers=workers)()


def started(
    project: RandomProject, *words: str, begin: Callable[[], object] = lambda: None, workers: bool = False
) -> Callable[[], Said]:
    """Begin what `build` does; call what is returned to wait for its end."""

    def prepare() -> None:
        start_in(project.root)
        if workers:
            pool.LocalExecutor = Workers  # type: ignore[misc]
        begin()

    return start(project.root, "build", RECIPE, *QUIET, *words, begin=prepare)


def placed(project: RandomProject, said: Said) -> dict[str, str]:
    """Node -> what lies in `out/`, by what a build printed."""
    assert said.code == 0, (project.edits, said.text)
    found = dict(re.findall(r"^(n\d+)\t(.+)$", said.text, re.MULTILINE))
    return {node: (project.root / path).read_text() for node, path in found.items()}


def expected(files: Mapping[str, str], folder: Path, added: Mapping[str, int] | None = None) -> dict[str, str]:
    """Node -> what it returns, in a project of these files.

    Args:
        files: Path -> text.
        folder: Does not exist yet; the files are written there.
        added: Node -> the value of its option `add`, over the recipe's.
    """
    answer = folder.with_suffix(".json")
    pid = os.fork()
    if pid == 0:
        try:
            for path, text in files.items():
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                (folder / path).write_text(text)
            sys.meta_path[:] = [finder for finder in sys.meta_path if not hasattr(finder, "is_of_dxb")]
            start_in(folder, writes=False)
            answer.write_text(json.dumps(_evaluate(folder, added or {})))
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    result: dict[str, str] = json.loads(answer.read_text())
    return result


def _evaluate(folder: Path, added: Mapping[str, int]) -> dict[str, str]:
    recipe = yaml.safe_load(next(folder / path for path in RECIPES if (folder / path).exists()).read_text())
    known = {f"${name}": _input(folder / path) for name, path in recipe["inputs"].items()}
    for name, node in recipe["nodes"].items():
        rule, backend = _rule(folder, node["rule"].partition(".")[2])
        inputs = {slot: known[node[slot]] for slot in ("a", "b", "tree") if slot in node}
        options = rule.options(add=added.get(name, node.get("add", 0)))
        known[f"${name}"] = rule(SimpleNamespace(backend=backend), **inputs, options=options)
    return {name: known[f"${name}"].data.decode() for name in recipe["nodes"]}


def _input(path: Path) -> File | Folder:
    if path.is_file():
        return File(data=path.read_bytes())
    inside = {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}
    return Folder(files=inside)


def _rule(folder: Path, name: str) -> tuple[Any, Any]:
    """A rule and its backend: the project's own comes first, and the backend that is first by name."""
    place = next(folder / place for place in (STAGE, PLUG) if (folder / place / f"{name}.py").exists())
    package = f"mounted_{len(place.parts)}"
    if package not in sys.modules:
        spec = ModuleSpec(package, None, is_package=True)
        spec.submodule_search_locations = [str(place.parent)]
        sys.modules[package] = importlib.util.module_from_spec(spec)
    load = partial(importlib.import_module, package=package)
    backends = [load(f".toy.{file.stem}") for file in sorted(place.glob(f"{name}_*.py"))]
    return getattr(load(f".toy.{name}"), name), next(iter(backends), None)
