"""The states of a node, from the module that keeps them."""

from __future__ import annotations

import ast
import inspect

from dextera_build.engine import states

from .markdown import code, join, table


def page() -> str:
    """The picture in the module's docstring, and the meaning of each state."""
    _, _, rest = (inspect.getdoc(states) or "").partition("\n\n")
    tree = ast.parse(inspect.getsource(states))
    kind = next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == "State")
    rows = [
        [code(_name(before)), str(after.value.value)]
        for before, after in zip(kind.body, kind.body[1:], strict=False)
        if isinstance(before, ast.Assign) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
    ]
    return join(f"```text\n{rest}\n```", table(["state", "meaning"], rows))


def _name(node: ast.Assign) -> str:
    return ast.unparse(node.targets[0])
