"""The docstrings of fields, read from the source on demand.

Pydantic can read them when a class is created, but that would slow down processes that run rules and never need them.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from typing import get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo


def field_docs(kind: type[BaseModel]) -> dict[str, str]:
    """Field -> its docstring, if it has one; a `description` of the field takes precedence."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if issubclass(base, BaseModel) and base is not BaseModel:
            with suppress(OSError, TypeError):  # generics with parameters and generated classes have no source
                found |= _below(inspect.getsource(base))
    said = {name: field.description for name, field in kind.model_fields.items() if field.description}
    return {name: text for name, text in (found | said).items() if name in kind.model_fields}


def bounds(field: FieldInfo) -> str:
    """The bounds of an option as text, `> 0, <= 1`, including those of a tuple's numbers; "" without bounds."""
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    marks = dict.fromkeys([*field.metadata, *_marks(field.annotation)])
    return ", ".join(
        f"{sign} {limit:g}"
        for mark in marks
        for name, sign in signs.items()
        if (limit := getattr(mark, name, None)) is not None
    )


def _marks(annotation: object) -> Iterator[object]:
    for part in get_args(annotation):
        # pydantic wraps the bounds of its own types, `Field(ge=0, le=1)`, into one object.
        yield from getattr(part, "metadata", ()) or (part,)
        yield from _marks(part)


def _below(source: str) -> dict[str, str]:
    (written,) = ast.parse(textwrap.dedent(source)).body
    assert isinstance(written, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(written.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }
