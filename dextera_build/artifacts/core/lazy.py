"""Dictionaries whose values are loaded when they are used."""

from __future__ import annotations

from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from pathlib import Path
from typing import Any, TypeVar

from dextera_build.artifacts.core.content import Content

V = TypeVar("V")


class Lazy(dict[str, V]):
    """A read-only dictionary that loads each value on access.

    Args:
        sources: Key -> source from which `load` makes the value.
        load: Makes a value.
        keep: Whether loaded values are cached; otherwise they are loaded at each access.
    """

    def __init__(self, sources: Mapping[str, Any], load: Callable[[Any], V], *, keep: bool) -> None:
        super().__init__(sources)  # sources are placeholders for values until these are accessed
        self._load, self._keep = load, keep
        self._loaded: dict[str, V] = {}

    def source(self, key: str) -> Any:
        """The source of a key's value."""
        return super().__getitem__(key)

    def __getitem__(self, key: str) -> V:
        """The value, loaded on access."""
        if key in self._loaded:
            return self._loaded[key]
        value = self._load(super().__getitem__(key))
        if self._keep:
            self._loaded[key] = value
        return value

    def get(self, key: str, default: Any = None) -> Any:
        """The value, or the default if there is no such key."""
        return self[key] if key in self else default  # noqa: SIM401 - it would be this method

    # Copies of a dictionary read the values of a subclass directly unless it defines these.
    def __iter__(self) -> Iterator[str]:
        """The keys in order."""
        return super().__iter__()

    def keys(self) -> Any:
        """The keys in order."""
        return Mapping.keys(self)

    def values(self) -> Any:
        """The values in order, loaded one by one."""
        return ValuesView(self)

    def items(self) -> Any:
        """Keys with values in order, loaded one by one."""
        return ItemsView(self)

    def __eq__(self, other: object) -> bool:
        """Whether the other dictionary has the same keys and values."""
        if not isinstance(other, Mapping):
            return NotImplemented
        return len(self) == len(other) and all(key in other and self[key] == other[key] for key in self)

    __hash__ = None

    def __or__(self, other: Any) -> Any:
        """A plain dictionary of both."""
        return {**dict(self.items()), **other}

    def __ror__(self, other: Any) -> Any:
        """A plain dictionary of both."""
        return {**other, **dict(self.items())}

    def copy(self) -> dict[str, V]:
        """A plain dictionary with all values."""
        return dict(self.items())

    def __reduce__(self) -> Any:
        """As a plain dictionary."""
        return dict, (dict(self.items()),)

    def __repr__(self) -> str:
        """The keys; no value is loaded."""
        return f"Lazy({', '.join(self)})"

    def _frozen(self, *_: object, **__: object) -> Any:
        raise TypeError("values of artifacts do not change")

    __setitem__ = __delitem__ = pop = popitem = setdefault = update = clear = __ior__ = _frozen


def contents(sources: Mapping[str, Content]) -> Lazy[bytes]:
    """Bytes by name, read from a file or a blob at each use."""
    return Lazy(sources, lambda content: content.read(), keep=False)


def sizes(files: Mapping[str, bytes]) -> Iterator[int]:
    """Sizes of files [bytes], without reading those that are not in memory."""
    for name in files:
        yield files.source(name).length() if isinstance(files, Lazy) else len(files[name])


def place(files: Mapping[str, bytes], name: str, target: Path) -> None:
    """Write a file to `target`, sharing blocks if the file system can."""
    if isinstance(files, Lazy):
        files.source(name).place(target)
    else:
        target.write_bytes(files[name])
