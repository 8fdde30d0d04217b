"""The table of errors, from the places in the code that raise them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import dextera_build
from dextera_build import errors
from dextera_build.code.loader import bundled

from .markdown import code, escaped, join, table

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


def raised(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """(code, message) of every call that names a code.

    What is filled in stands as an ellipsis; where that is all, what the function says of itself stands instead.
    """
    constants = _constants(tree)
    stack: list[tuple[ast.AST, str]] = [(tree, ast.get_docstring(tree) or "")]
    while stack:
        node, about = stack.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            about = (ast.get_docstring(node) or about).partition("\n")[0]
        stack += [(child, about) for child in ast.iter_child_nodes(node)]
        if isinstance(node, ast.Call) and node.args:
            text = _text(node.args[0])
            shown = text if re.search(r"\w", text) else about
            yield from ((name, shown) for name in _codes(node, constants))


def _constants(tree: ast.Module) -> dict[str, ast.expr]:
    assigned = [node for node in ast.walk(tree) if isinstance(node, ast.Assign)]
    return {name.id: node.value for node in assigned for name in node.targets if isinstance(name, ast.Name)}


def _codes(call: ast.Call, constants: dict[str, ast.expr]) -> Iterator[str]:
    for value in (word.value for word in call.keywords if word.arg == "code"):
        # `code=CODE` and `code=self.CODE` stand for a constant of the same file.
        found = constants.get(getattr(value, "id", getattr(value, "attr", "")), value)
        if isinstance(found, ast.Constant) and str(found.value).startswith("DXB-"):
            yield str(found.value)


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
    kind = next(kind for kind in known if kind.family == letter)
    rows = [[code(name), " / ".join(escaped(text) for text in sorted(texts))] for name, texts in sorted(found.items())]
    about = (kind.__doc__ or "").partition("\n")[0]
    return join(f"## {kind.__name__}", about, table(["code", "message"], rows))
