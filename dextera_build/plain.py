"""Data classes that are cheap to define.

The decorator of the standard library compiles up to seven functions for each class, and to define the classes of the
engine took as long as a small build takes to run its nodes. This one takes the same words, and `fields`, `replace` and
`asdict` know what it makes; but only `__init__` is compiled, when the first object is made, since most commands make
none of most classes. And that nothing is assigned to what is `frozen` is for the type checker to see.
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
        made = dataclasses.dataclass(init=False, repr=False, eq=False, **more)(kind)
        fields = dataclasses.fields(made)
        functions = {"__init__": _beginning(made), "__repr__": _text([field.name for field in fields if field.repr])}
        if eq:
            compared = [field.name for field in fields if field.compare]
            functions |= _comparing(attrgetter(*compared) if compared else lambda value: (), frozen)
        for name, function in functions.items():
            if name not in kind.__dict__:
                setattr(made, name, function)
        return made


def _beginning(kind: Any) -> Any:
    """Makes way for what sets the fields of an object, when there is the first."""

    def begin(self: object, *values: object, **named: object) -> None:
        kind.__init__ = _setter(kind)
        kind.__init__(self, *values, **named)

    return begin


def _setter(kind: Any) -> Any:
    words, lines, given = ["self"], [], dict[str, Any]()
    for field in dataclasses.fields(kind):
        name, default, factory = field.name, field.default, field.default_factory
        given[f"_{name}"] = default if factory is dataclasses.MISSING else factory
        value = f"_{name}" if factory is dataclasses.MISSING else f"_{name}()"
        is_open = default is dataclasses.MISSING and factory is dataclasses.MISSING
        if field.init:
            words.append(name if is_open else f"{name}=_{name}")
            value = f"{value} if {name} is _{name} else {name}" if value.endswith("()") else name
        if field.init or not is_open:
            lines.append(f"self.{name} = {value}")
    if hasattr(kind, "__post_init__"):
        lines.append("self.__post_init__()")
    exec(f"def __init__({', '.join(words)}):\n " + "\n ".join(lines or ["pass"]), given)
    made = given["__init__"]
    made.__qualname__, made.__module__ = f"{kind.__qualname__}.__init__", kind.__module__
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
