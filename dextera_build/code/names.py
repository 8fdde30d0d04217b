"""Origins of the names in a module, as far as its own text decides them."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cached_property

FALSE = "False"
"""Origin of a name that is bound once, to False."""
_STAR = "*"
_BLOCKS = frozenset({"body", "orelse", "handlers", "finalbody", "cases", "items"})
_TARGETS = frozenset({"targets", "target", "optional_vars", "pattern"})
_NAMELESS = frozenset({ast.Expr, ast.Assign, ast.Return, ast.If, ast.For, ast.AugAssign, ast.AnnAssign, ast.Raise})


class Names:
    """Resolves names to the modules from which they were imported; the module is searched on first use.

    Args:
        module: The syntax tree of the module.
        data: Its text.
    """

    def __init__(self, module: ast.Module, data: bytes) -> None:
        self._module = module
        self._may_assign_inside = b":=" in data

    def origin(self, node: ast.expr) -> str:
        """`typing.Protocol`, `builtins.property` or `FALSE` for a name or an attribute; "" if it may be anything.

        The scopes of functions count, too: a parameter or a local variable of the same name makes a name unknown.
        """
        inner = ""
        while isinstance(node, ast.Attribute):
            inner = f".{node.attr}{inner}"
            node = node.value
        if not isinstance(node, ast.Name) or _STAR in self._bound:
            return ""
        found = list(self._bound.get(node.id, [f"builtins.{node.id}"]))
        return f"{found[0]}{inner}" if len(found) == 1 and found[0] else ""

    @cached_property
    def _bound(self) -> dict[str, Counter[str]]:
        """Name -> the origins that it is bound to, with their number; "" for one that is not an import."""
        found: dict[str, Counter[str]] = defaultdict(Counter)
        for node in _statements(self._module):
            for name, origin in _bindings(node):
                found[name][origin] += 1
        for inner in ast.walk(self._module) if self._may_assign_inside else ():
            if isinstance(inner, ast.NamedExpr):
                found[inner.target.id][""] += 1
        for node in self._module.body:
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and node.value.value is False:
                name = getattr(node.targets[0], "id", "")
                if found.get(name) == Counter([""]):
                    found[name] = Counter([FALSE])
        return dict(found)


def _statements(module: ast.Module) -> Iterator[ast.AST]:
    """All statements, nested ones included, with the targets that they assign to; most expressions are left out."""
    todo: list[ast.AST] = [module]
    while todo:
        node = todo.pop()
        yield node
        for field in node._fields:
            if field in _BLOCKS:
                todo += getattr(node, field)
            elif field in _TARGETS and (value := getattr(node, field)) is not None:
                for target in value if isinstance(value, list) else [value]:
                    if isinstance(target, ast.Name):
                        yield target
                    else:
                        yield from ast.walk(target)


def _bindings(node: ast.AST) -> Iterator[tuple[str, str]]:
    """The names that a node itself binds, each with its origin."""
    if isinstance(node, ast.Name):
        if not isinstance(node.ctx, ast.Load):
            yield node.id, ""
    elif isinstance(node, ast.Import | ast.ImportFrom):
        yield from (_imported(node, alias) for alias in node.names)
    elif isinstance(node, ast.Global | ast.Nonlocal):
        yield from ((name, "") for name in node.names)
    elif type(node) not in _NAMELESS:
        # Functions, classes, exceptions, captures, aliases of types; the rest of a mapping.
        for field in ("name", "rest"):
            name = getattr(node, field, None)
            if name is not None:
                yield (name if isinstance(name, str) else name.id), ""
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            every = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg)
            yield from ((each.arg, "") for each in every if each is not None)


def _imported(node: ast.Import | ast.ImportFrom, alias: ast.alias) -> tuple[str, str]:
    """A name that is bound by an import, and its origin."""
    if isinstance(node, ast.ImportFrom):
        return alias.asname or alias.name, "" if node.level else f"{node.module}.{alias.name}"
    top = alias.name.partition(".")[0]
    return (alias.asname, alias.name) if alias.asname else (top, top)
