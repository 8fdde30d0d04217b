"""Data classes that are cheap to define.

The decorator of the standard library compiles up to seven functions for each class, and to define the classes of the
engine took as long as a small build takes to run its nodes. This one takes the same words, and `fields`, `replace` and
`asdict` know what it makes; but only `__init__` is compiled, and that nothing is assigned to what is `frozen` is for
the type checker to see.
"""

from __future__ import annotations

import dataclasses
from operator import attrgetter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(kind: Any = None, *, frozen: bool = False, eq: bool = True, **more: bool) -> Any:
        """As `dataclasses.dataclass`; what is `frozen` has a hash, and may be assigned to all the same."""
        if kind is None:
            return lambda later: dataclass(later, frozen=frozen, eq=eq, **more)
        made = dataclasses.dataclass(repr=False, eq=False, **more)(kind)
        fields = dataclasses.fields(made)
        functions = {"__repr__": _text([field.name for field in fields if field.repr])}
        if eq:
            compared = [field.name for field in fields if field.compare]
            functions |= _comparing(attrgetter(*compared) if compared else lambda value: (), frozen)
        for name, function in functions.items():
            if name not in kind.__dict__:
                setattr(made, name, function)
        return made


def _text(names: list[str]) -> Any:
    def text(self: object) -> str:
        said = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{type(self).__qualname__}({said})"

    return text


def _comparing(values: Any, frozen: bool) -> dict[str, Any]:
    def equals(self: object, other: object) -> bool:
        return values(self) == values(other) if type(other) is type(self) else NotImplemented

    def hashed(self: object) -> int:
        return hash(values(self))

    return {"__eq__": equals, "__hash__": hashed if frozen else None}
