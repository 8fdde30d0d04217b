"""The types that a declared type allows in a field: choices of a union, parts of a container."""

from __future__ import annotations

import types
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin

from dextera_build.errors import ArtifactError


@cache
def arguments(hint: Any) -> list[Any]:
    """The types that the first tuple, list or dict of a declaration holds; none if it has no such choice."""
    for choice in _choices(hint):
        if get_origin(choice) in (tuple, list, dict):
            return list(get_args(choice))
    return []


@cache
def first(hint: Any, base: type) -> Any:
    """The first choice of a declaration that derives from `base`.

    Raises:
        ArtifactError: None does.
    """
    for choice in _choices(hint):
        if isinstance(choice, type) and issubclass(choice, base):
            return choice
    raise ArtifactError(f"a stored {base.__name__} stands where {hint!r} is declared", code="DXB-A108")


def _choices(hint: Any) -> tuple[Any, ...]:
    if get_origin(hint) in (Union, types.UnionType):
        return tuple(part for choice in get_args(hint) for part in _choices(choice))
    if get_origin(hint) is Annotated:
        return _choices(get_args(hint)[0])
    return (hint,)
