"""Digests of Python source without comments, docstrings and positions, equal on every version of Python.

Digests are kept per top-level definition, so that `dxb why` can name the function that changed. Statements of one name
are digested in their order; that of the others is an entry of its own.
"""

from __future__ import annotations

import ast
import hashlib
import re
import threading
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache

from dextera_build import digest
from dextera_build.code import order
from dextera_build.code.names import FALSE, Names
from dextera_build.code.order import ORDER
from dextera_build.errors import Place, RecipeError

_MODULE = "<module>"
_PARSING = threading.Lock()
# Fields added by newer Python versions are empty for older syntax, and empty fields are left out.
_UNSAID = {"ctx", "kind", "type_comment", "type_ignores"}

# Arguments of `@rule(...)` and `BACKEND = Backend(...)` about how a call runs; they affect neither results nor keys.
_NEEDS = {"cpus", "memory_gb", "gpus", "resources", "retries", "retry_on", "retry_wait_s"}
_BACKEND_NEEDS = {"gpu_gb", "summary"}
_BACKEND = {"dextera_build.rule.Backend", "dextera_build.rule.backend.Backend"}
_NOT_RUN = {"typing.TYPE_CHECKING", "typing_extensions.TYPE_CHECKING", FALSE}
_ALL_NAMES = re.compile(rb"\b(vars|globals|locals|__dict__)\b")


@dataclass(frozen=True)
class Source:
    """The digested contents of a source file."""

    definitions: dict[str, str]
    """Top-level definition, or `<module>` -> digest; `ORDER` -> the order as far as it can matter."""
    lines: dict[str, int]
    imports: tuple[tuple[int, str, tuple[str, ...]], ...]
    """(level, module, imported names) of every import statement that may run."""
    exports: tuple[str, ...] = ()
    """`__all__`, if it is a literal."""
    sequence: str = ""
    """The order of all statements, for code that lists the names of a module."""
    lists_names: bool = False
    """Whether it may list the names of a module, by `vars(module)` or the like."""


def tree(data: bytes, file: str) -> ast.Module:
    """The syntax tree of a source file.

    Locked, because Python 3.11 fails if two threads build trees at once.

    Raises:
        RecipeError: It is not Python, or nested more deeply than Python can read.
    """
    try:
        with _PARSING, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of invalid escapes; importing the module shows the warning
            return ast.parse(data, file)
    except (RecursionError, MemoryError):
        raise too_deep(file) from None
    except (SyntaxError, ValueError) as error:
        said, line = getattr(error, "msg", str(error)), getattr(error, "lineno", None) or 0
        column = getattr(error, "offset", None) or 0
        raise RecipeError(f"not valid Python: {said}", code="DXB-R206", where=Place(file, line, column)) from None


def too_deep(file: str) -> RecipeError:
    """The error for a file nested too deeply for Python's parser."""
    return RecipeError(
        "an expression or a statement is nested too deeply for Python to read",
        code="DXB-R210",
        where=Place(file),
        hint="split a long sum or chain over several statements, turn a long `elif` chain into a table",
    )


@lru_cache(maxsize=2048)
def source(data: bytes, file: str) -> Source:
    """Parse a source file and digest its definitions; a file that is unchanged is parsed once per process.

    Raises:
        RecipeError: It is not Python, or nested more deeply than Python can read.
    """
    module = tree(data, file)
    names = Names(module, data)
    imports = tuple(_imports(module, names))
    exports = next((found for node in module.body if (found := _exports(node)) is not None), ())
    _strip_needs(module, names)
    statements = [(_definition(node), node) for node in module.body if not _is_text(node)]
    parts: dict[str, list[str]] = {}
    lines: dict[str, int] = {}
    for name, node in statements:
        parts.setdefault(name, []).append(dump(node))
        lines.setdefault(name, node.lineno)
    definitions = {name: digest.of_value(dumps)[:16] for name, dumps in parts.items()}
    if said := order.of(statements, names):
        definitions[ORDER] = said
    lists_names = _ALL_NAMES.search(data) is not None and any(map(_is_about_names, ast.walk(module)))
    return Source(definitions, lines, imports, exports, order.spelled(name for name, _ in statements), lists_names)


def dump(node: ast.AST) -> str:
    """Digest of a syntax tree without docstrings; iterative, because trees may be deep.

    Half of the time of a first plan, so names of fields are looked up once per kind of node.
    """
    said: list[str] = []
    todo: list[object] = [node]
    while todo:
        part = todo.pop()
        if isinstance(part, str):
            said.append(part)
        elif isinstance(part, list):
            said.append("[")
            todo.append("]")
            for item in reversed(part):
                todo += (item, ",")
        elif isinstance(part, ast.Constant) or not isinstance(part, ast.AST):
            said.append(_constant(part.value if isinstance(part, ast.Constant) else part))
        else:
            opening, fields = _form(type(part).__name__, part._fields)
            said.append(opening)
            todo.append(")")
            for name, mark in fields:
                value = _field(part, name)
                if isinstance(value, str):
                    todo.append(mark + value)
                elif isinstance(value, ast.Name):
                    todo.append(f"{mark}(Name id={len(value.id)}:{value.id})")
                elif value is not None:
                    todo += (value, mark)
    return hashlib.sha256("".join(said).encode("utf-8", "surrogatepass")).hexdigest()


@cache
def _form(kind: str, fields: tuple[str, ...]) -> tuple[str, tuple[tuple[str, str], ...]]:
    """How a node of some kind begins, and its fields from last to first, with the mark before each."""
    return f"({kind}", tuple((name, f" {name}=") for name in reversed(fields) if name not in _UNSAID)


def _field(node: ast.AST, name: str) -> object:
    """A field of a node, normalized across Python versions; None if empty."""
    value = getattr(node, name, None)
    if isinstance(value, str):
        # The length prefix keeps names distinct from structural marks.
        return f"{len(value)}:{value}"
    if isinstance(value, ast.JoinedStr) and name == "format_spec" and not _pieces(value):
        return None
    if isinstance(value, list):
        if isinstance(node, ast.JoinedStr):
            return _pieces(node) or None
        return [inner for inner in value if not _is_text(inner)] or None
    return value


def _pieces(node: ast.JoinedStr) -> list[object]:
    """The parts of an f-string with adjacent text merged, because Python versions split it differently."""
    found: list[object] = []
    text = ""
    for piece in node.values:
        if isinstance(piece, ast.Constant):
            text += str(piece.value)
            continue
        found += [ast.Constant(text), piece] if text else [piece]
        text = ""
    return [*found, ast.Constant(text)] if text else found


def _constant(value: object) -> str:
    kind = type(value).__name__
    if isinstance(value, str):
        return f"{kind}{len(value)}:{value}"
    # Python refuses `repr` of a very large integer.
    return f"{kind}:{hex(value)}" if isinstance(value, int) and not isinstance(value, bool) else f"{kind}:{value!r}"


def _imports(module: ast.Module, names: Names) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    todo: list[ast.AST] = [module]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import):
            yield from ((0, alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, node.module or "", tuple(alias.name for alias in node.names)
        else:
            for block in _blocks(node, names):
                todo += getattr(node, block, ())


def _blocks(node: ast.AST, names: Names) -> tuple[str, ...]:
    """Fields with the nested statements that may run, leaving out `TYPE_CHECKING` blocks."""
    if isinstance(node, ast.If):
        negated = isinstance(node.test, ast.UnaryOp) and isinstance(node.test.op, ast.Not)
        test = node.test.operand if isinstance(node.test, ast.UnaryOp) and negated else node.test
        if isinstance(test, ast.Name | ast.Attribute) and names.origin(test) in _NOT_RUN:
            return ("body",) if negated else ("orelse",)
    return ("body", "orelse", "handlers", "finalbody", "cases")


def _exports(node: ast.stmt) -> tuple[str, ...] | None:
    if isinstance(node, ast.Assign | ast.AnnAssign) and _definition(node) == "__all__":
        items = node.value.elts if isinstance(node.value, ast.List | ast.Tuple) else []
        return tuple(item.value for item in items if isinstance(item, ast.Constant) and isinstance(item.value, str))
    return None


def _is_text(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _definition(node: ast.stmt) -> str:
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return node.name
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    names = [target.id for target in targets if isinstance(target, ast.Name)]
    return names[0] if names else _MODULE


def _is_about_names(node: ast.AST) -> bool:
    return _ALL_NAMES.fullmatch(getattr(node, "attr", getattr(node, "id", "")).encode()) is not None


def _strip_needs(module: ast.Module, names: Names) -> None:
    for node in module.body:
        if isinstance(node, ast.FunctionDef):
            marks, known, out = node.decorator_list, order.RULE, _NEEDS
        elif isinstance(node, ast.Assign) and _definition(node) == "BACKEND":
            marks, known, out = [node.value], _BACKEND, _BACKEND_NEEDS
        else:
            continue
        for mark in marks:
            if isinstance(mark, ast.Call) and names.origin(mark.func) in known:
                words = [word for word in mark.keywords if word.arg not in out or not order.is_plain(word.value)]
                mark.keywords = words
