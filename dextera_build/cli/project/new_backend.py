"""The file that `dxb new backend` writes: the functions of the rule's `Protocol`, to be filled in."""

from __future__ import annotations

import ast
import builtins
import inspect
import sys
import textwrap
from collections.abc import Iterator
from typing import Any

from dextera_build.code.loader import RuleFile

_TEXT = '''"""Backend `{backend}` of {path}."""

from __future__ import annotations

{imports}

# Read without importing this file: literals only.
BACKEND = Backend(summary="what it does, in one line", profiles=(), packages=())


class {kind}Options(Options):
    """Options of backend `{backend}`; in a recipe `{backend}: {{seed: 1}}`."""

    seed: int = 0
    """Seed of its random numbers."""
'''
_FUNCTION = '''

def {name}({parameters}) -> {returns}:
    """{doc}"""
    ctx.fail("`{name}` of backend `{backend}` is not written yet", hint="fill it in: {file}")
'''


def text(found: RuleFile, backend: str, file: str, *, beside: bool) -> str:
    """A backend whose functions have the right form and fail.

    Args:
        found: Its rule.
        backend: Its name.
        file: The file to write, as messages show it.
        beside: Whether it lies beside the rule, so that it can import what the rule's file defines.
    """
    kind = "".join(part.capitalize() for part in backend.split("_"))
    protocol = found.rule.protocol
    methods = [each for each in vars(protocol).values() if inspect.isfunction(each)] if protocol is not None else []
    imports = _imports(ast.parse(found.file.read_text()), found.file.stem) if methods else {}
    known = {name: line for name, line in imports.items() if beside or not line.startswith("from .")}
    used = {"from dextera_build.rule import Backend, Context, Options"}
    parts = []
    for method in methods:
        if method.__name__.startswith("_"):
            continue
        signature = inspect.signature(method)
        inner = [each for name, each in signature.parameters.items() if name not in ("self", "options")]
        parameters = [f"{each.name}: {_known(each.annotation, known, used)}" for each in inner]
        parts.append(
            _FUNCTION.format(
                name=method.__name__,
                parameters=", ".join([*parameters, f"options: {kind}Options"]),
                returns=_known(signature.return_annotation, known, used),
                doc=inspect.getdoc(method) or "",
                backend=backend,
                path=found.path,
                file=file,
            )
        )
    head = _TEXT.format(backend=backend, path=found.path, kind=kind, imports=_sorted(used))
    return textwrap.dedent(head) + "".join(parts)


def _imports(tree: ast.Module, stem: str) -> dict[str, str]:
    """Name -> the statement that imports it, for all names of a rule's file."""
    found: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.Import):
            found |= {each.asname or each.name: ast.unparse(ast.Import([each])) for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            lines = {each.asname or each.name: ast.ImportFrom(node.module, [each], node.level) for each in node.names}
            found |= {name: ast.unparse(line) for name, line in lines.items()}
        elif isinstance(node, ast.ClassDef):
            found[node.name] = f"from .{stem} import {node.name}"
    return found


def _known(annotation: Any, known: dict[str, str], used: set[str]) -> str:
    """An annotation, with its imports added to `used`; `Any` if a name of it cannot be imported."""
    words = [node.id for node in ast.walk(ast.parse(str(annotation))) if isinstance(node, ast.Name)]
    lines = set(_lines(words, known))
    if None in lines:
        used.add("from typing import Any")
        return "Any"
    used |= {line for line in lines if line}
    return str(annotation)


def _sorted(lines: set[str]) -> str:
    """Import statements as a formatter orders them: the standard library, other packages, dxb, the folder itself."""
    merged: dict[str, list[str]] = {}
    for line in lines:
        module, _, name = line.partition(" import ")
        merged.setdefault(module, []).extend(name.split(", ") if name else [])
    groups: list[list[str]] = [[], [], [], []]
    for module, parts in sorted(merged.items()):
        name = module.split()[1]
        top = name.partition(".")[0]
        place = 3 if not top else 2 if top == "dextera_build" else 0 if top in sys.stdlib_module_names else 1
        groups[place].append(f"{module} import {', '.join(sorted(parts))}" if parts else module)
    return "\n\n".join("\n".join(group) for group in groups if group)


def _lines(words: list[str], known: dict[str, str]) -> Iterator[str | None]:
    for word in words:
        if word not in ("Context", *vars(builtins)):
            yield known.get(word)
