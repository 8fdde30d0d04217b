"""What fields mean: the docstrings below them, read from the source when somebody asks.

Pydantic can do that for every class as it is made; the process of a rule, which shows them to nobody, waits for it.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from contextlib import suppress
from itertools import pairwise

from pydantic import BaseModel


def meanings(kind: type[BaseModel]) -> dict[str, str]:
    """Field -> what its docstring says, for the fields that have one; a description that a field bears comes first."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if issubclass(base, BaseModel) and base is not BaseModel:
            with suppress(OSError, TypeError):  # a generic with its parameters has no source, nor what a program made
                found |= _below(inspect.getsource(base))
    said = {name: field.description for name, field in kind.model_fields.items() if field.description}
    return {name: text for name, text in (found | said).items() if name in kind.model_fields}


def _below(source: str) -> dict[str, str]:
    (written,) = ast.parse(textwrap.dedent(source)).body
    assert isinstance(written, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(written.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }
