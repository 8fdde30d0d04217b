"""The meaning of error codes: the section of `docs/common_errors.md`, if any, and every message in the code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from dextera_build import errors
from dextera_build.code.loader import PACKAGE, bundled


@dataclass(frozen=True)
class ErrorSite:
    """An error as one place in the code makes it; an ellipsis replaces each inserted value."""

    code: str
    message: str
    facts: tuple[str, ...] = ()
    """Names of its facts."""
    hint: str = ""


def sites(code: str = "DXB-") -> Iterator[ErrorSite]:
    """Every place that makes an error whose code begins with `code`."""
    for text in _texts(PACKAGE, bundled("rules")):
        if code in text:
            yield from (error for error in _errors(text) if error.code.startswith(code))


@cache
def _texts(package: Path, rules: Path) -> tuple[str, ...]:
    """The sources that may make errors, by path."""
    own = [file for file in package.rglob("*.py") if file.relative_to(package).parts[0] not in ("docs", "_bundled")]
    return tuple(file.read_text() for file in sorted([*own, *rules.rglob("*.py")]))


@cache
def _errors(text: str) -> tuple[ErrorSite, ...]:
    return tuple(_read(ast.parse(text)))


def section(code: str) -> list[str]:
    """The paragraphs and examples about a code that users meet often; an example begins with three backticks.

    The page is docs/common_errors.md; a code without a section gives none.
    """
    text = (PACKAGE / "docs" / "common_errors.md").read_text(encoding="utf-8")
    found = re.search(rf"^## {code}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)
    return re.split(r"\n\n(?!\s*\n)", found[1].strip()) if found else []


def explained() -> list[str]:
    """The codes that have a section."""
    text = (PACKAGE / "docs" / "common_errors.md").read_text(encoding="utf-8")
    return re.findall(r"^## (DXB-\w+)$", text, re.MULTILINE)


def family(letter: str) -> type[errors.DxbError]:
    """The class of the errors whose codes begin with `DXB-<letter>`."""
    known = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.DxbError)]
    return next((kind for kind in known if kind.family == letter), errors.DxbError)


def _read(tree: ast.Module) -> Iterator[ErrorSite]:
    stack: list[tuple[ast.AST, str]] = [(tree, ast.get_docstring(tree) or "")]
    while stack:
        node, about = stack.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            about = (ast.get_docstring(node) or about).partition("\n")[0]
        stack += [(child, about) for child in ast.iter_child_nodes(node)]
        if isinstance(node, ast.Call) and node.args:
            text = _text(node.args[0])
            said = {word.arg: word.value for word in node.keywords}
            code, facts = said.get("code"), said.get("facts")
            names = tuple(_text(key) for key in facts.keys if key) if isinstance(facts, ast.Dict) else ()
            hint = _text(said["hint"]) if "hint" in said else ""
            hint = hint if re.search(r"\w", hint) else ""
            # If the whole message is an inserted value, use the summary of the function instead.
            message = text if re.search(r"\w", text) else about
            if isinstance(code, ast.Constant) and str(code.value).startswith("DXB-"):
                yield ErrorSite(str(code.value), message, names, hint)


def _text(node: ast.expr) -> str:
    return re.sub("…+", "…", _pieces(node))


def _pieces(node: ast.expr) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    if isinstance(node, ast.BinOp):
        return _pieces(node.left) + _pieces(node.right)
    return "…"
