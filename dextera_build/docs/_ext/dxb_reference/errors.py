"""The table of errors, from the places in the code that raise them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import dextera_build
from dextera_build import errors
from dextera_build.loader import bundled

from .markdown import code, join, table

PACKAGE = Path(dextera_build.__file__).parent


def page() -> str:
    """One table per family of codes."""
    found: dict[str, dict[str, set[str]]] = {}
    for file in sorted([*PACKAGE.rglob("*.py"), *bundled("rules").rglob("*.py")]):
        if "_bundled" in file.parts or "docs" in file.parts:
            continue
        for name, text in raised(ast.parse(file.read_text())):
            found.setdefault(name.split("-")[1][0], {}).setdefault(name, set()).add(text)
    return join(*(_family(letter, found[letter]) for letter in sorted(found)))


def raised(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """(code, message) of every call that names a code; what is filled in stands as an ellipsis."""
    constants = {
        target.id: node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and node.args:
            for value in (word.value for word in node.keywords if word.arg == "code"):
                # `code=CODE` and `code=self.CODE` stand for a constant of the same file.
                value = constants.get(getattr(value, "id", getattr(value, "attr", "")), value)
                if isinstance(value, ast.Constant) and str(value.value).startswith("DXB-"):
                    yield str(value.value), _text(node.args[0])


def _text(node: ast.expr) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    if isinstance(node, ast.BinOp):
        return _text(node.left) + _text(node.right)
    return "…"


def _family(letter: str, found: dict[str, set[str]]) -> str:
    known = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.DxbError)]
    kinds = {kind.family: kind for kind in known}
    kind = kinds[letter]
    about = (kind.__doc__ or "").split("\n")[0]
    rows = [[code(name), " / ".join(sorted(texts))] for name, texts in sorted(found.items())]
    return join(f"## {kind.__name__}", f"{about}", f"Exit code {kind.exit_code}.", table(["code", "message"], rows))
