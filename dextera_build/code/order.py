"""The order of a module's statements, as far as it can matter.

Two statements may change places if each only binds a name of its own, to something that is made without running code,
and neither reads the other's name. A run of such statements counts as a set; everything else counts in order.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Sequence, Set
from itertools import groupby

from dextera_build.code.names import Names

ORDER = "order of statements"
"""Entry for it among the definitions of a source."""
RULE: Set[str] = frozenset({"dextera_build.rule.rule", "dextera_build.rule.declaration.rule"})
# What these run is known: they look at nothing but the decorated object and the types that it names.
_OF_FUNCTIONS = RULE
_OF_CLASSES = frozenset({"dataclasses.dataclass"})
_OF_METHODS = frozenset({"builtins.property", "builtins.classmethod", "builtins.staticmethod"})
_BASES = frozenset({"typing.Protocol", "dextera_build.rule.Options", "dextera_build.rule.options.Options"})

_PLAIN = (ast.Constant, ast.Name, ast.Tuple, ast.List, ast.expr_context, ast.unaryop, ast.operator)
_NUMBER = (ast.Constant, ast.UnaryOp, ast.BinOp)
_ACTIVE = (ast.Call, ast.NamedExpr, ast.Await, ast.Yield, ast.YieldFrom)


def of(statements: Sequence[tuple[str, ast.stmt]], names: Names) -> str:
    """The names of statements in order, `<module>*3 LIMIT,area`: sets by commas, repetitions by a number.

    A set at the end is left out, because it holds whatever is not named before; "" if nothing can be confused.

    Args:
        statements: (name, statement) at the top level, without docstrings.
        names: The names of their module.
    """
    reader = _Reader(names, any(isinstance(node, ast.ImportFrom) and _is_future(node) for _, node in statements))
    parts: list[str] = []
    run: list[str] = []
    read: set[str] = set()
    for name, node in statements:
        reads = reader.reads(node)
        if run and (reads is None or name in read or not reads.isdisjoint(run)):
            parts.append(",".join(sorted(run)))
            run, read = [], set()
        if reads is None:
            parts.append(name)
        else:
            run.append(name)
            read |= reads
    return spelled(parts) if len({*parts}) > 1 else ""


def spelled(parts: Iterable[str]) -> str:
    """Parts of an order as text."""
    counted = ((part, len(list(same))) for part, same in groupby(parts))
    return " ".join(part if many == 1 else f"{part}*{many}" for part, many in counted)


def names_in(text: str) -> list[str]:
    """The names in the text of an order, one by one."""
    parts = (part.partition("*") for part in text.split())
    return [name for part, _, many in parts for _ in range(int(many or 1)) for name in part.split(",")]


class _Reader:
    """Tells the names that a statement reads when it runs, or None if it may do more than bind one name.

    Args:
        names: The names of its module.
        keeps_annotations: Whether annotations are not evaluated (`from __future__ import annotations`).
    """

    def __init__(self, names: Names, keeps_annotations: bool) -> None:
        self._names = names
        self._keeps = keeps_annotations

    def reads(self, node: ast.stmt, methods: Set[str] = _OF_FUNCTIONS) -> set[str] | None:
        """The answer for one statement; `methods`: the decorators of functions that are known to be harmless."""
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            return self._of_function(node, methods)
        if isinstance(node, ast.ClassDef):
            return self._of_class(node)
        if isinstance(node, ast.Assign):
            is_name = len(node.targets) == 1 and isinstance(node.targets[0], ast.Name)
            return _identifiers(node.value) if is_name and is_plain(node.value) else None
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            kept = [] if self._keeps else [node.annotation]
            is_harmless = (node.value is None or is_plain(node.value)) and all(map(_is_passive, kept))
            return _identifiers(node.value, *kept) if is_harmless else None
        return set() if isinstance(node, ast.Pass) else None

    def _of_function(self, node: ast.FunctionDef | ast.AsyncFunctionDef, known: Set[str]) -> set[str] | None:
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        several = [each for each in (node.args.vararg, node.args.kwarg) if each]
        types = [each for each in (node.returns, *(one.annotation for one in (*arguments, *several))) if each]
        seen = types if node.decorator_list or not self._keeps else []
        defaults = [each for each in (*node.args.defaults, *node.args.kw_defaults) if each]
        is_harmless = all(map(is_plain, defaults)) and all(map(_is_passive, seen))
        if is_harmless and not getattr(node, "type_params", []) and self._are_known(node.decorator_list, known):
            return _identifiers(*defaults, *seen, *node.decorator_list)
        return None

    def _of_class(self, node: ast.ClassDef) -> set[str] | None:
        bases = all(self._names.origin(base) in _BASES for base in node.bases)
        if not bases or node.keywords or getattr(node, "type_params", []):
            return None
        if not self._are_known(node.decorator_list, _OF_CLASSES):
            return None
        found = _identifiers(*node.bases, *node.decorator_list)
        for inner in node.body:
            if isinstance(inner, ast.Expr) and isinstance(inner.value, ast.Constant):
                continue
            reads = self.reads(inner, _OF_METHODS)
            # A base may call methods with such names, and evaluate annotations, while the class is made.
            if reads is None or (node.bases and getattr(inner, "name", "").startswith("__")):
                return None
            annotation = getattr(inner, "annotation", None)
            if annotation is not None and not _is_passive(annotation):
                return None
            found |= reads | _identifiers(annotation)
        return found

    def _are_known(self, decorators: Iterable[ast.expr], known: Set[str]) -> bool:
        for each in decorators:
            called = each.func if isinstance(each, ast.Call) else each
            given = [*each.args, *(word.value for word in each.keywords)] if isinstance(each, ast.Call) else []
            if self._names.origin(called) not in known or not all(map(is_plain, given)):
                return False
        return True


def _is_future(node: ast.ImportFrom) -> bool:
    return node.module == "__future__" and any(alias.name == "annotations" for alias in node.names)


def is_plain(value: ast.expr) -> bool:
    """Whether a value is made of constants and names, without running code of theirs."""
    return all(map(_is_simple, ast.walk(value)))


def _is_simple(node: ast.AST) -> bool:
    if isinstance(node, ast.Dict):
        return all(isinstance(key, ast.Constant) for key in node.keys)
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.operand, _NUMBER)
    if isinstance(node, ast.BinOp):
        return isinstance(node.left, _NUMBER) and isinstance(node.right, _NUMBER)
    return isinstance(node, _PLAIN)


def _is_passive(annotation: ast.expr) -> bool:
    """Whether an annotation calls nothing."""
    return not any(isinstance(node, _ACTIVE) for node in ast.walk(annotation))


def _identifiers(*values: ast.expr | None) -> set[str]:
    """Names in values, and words in their texts, which may be annotations."""
    found: set[str] = set()
    for value in values:
        for node in ast.walk(value) if value is not None else ():
            if isinstance(node, ast.Name):
                found.add(node.id)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.update(re.findall(r"\w+", node.value))
    return found
