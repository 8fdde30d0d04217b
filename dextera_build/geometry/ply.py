"""PLY files of scalar columns (G. Turk, The PLY Polygon File Format, 1994), as point clouds and Gaussians need them.

Files of all three encodings are read. Later elements with lists, such as the faces of a mesh, are skipped.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, field

import numpy as np

_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_NAMES = {code: name for name, code in reversed(_TYPES.items())}
"""Type code -> its name in a header, the older one of the two."""
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_LONGEST_HEADER = 1 << 16
"""Maximum length of a header [bytes], so that its end is not searched in data."""


@dataclass
class _Element:
    name: str
    count: int
    columns: list[tuple[str, str]] = field(default_factory=list)
    has_lists: bool = False


def read(data: bytes, element: str = "vertex") -> tuple[np.ndarray, tuple[str, ...]]:
    """The columns of one element as a structured array (N,), and the comments of the header.

    Raises:
        ValueError: The bytes are not PLY, are cut short, or have no such element.
    """
    order, elements, comments, start = _header(data)
    before: list[_Element] = []
    for each in elements:
        if each.name == element:
            break
        before.append(each)
    else:
        raise ValueError(f"it has no element `{element}`")
    if each.has_lists or any(other.has_lists for other in before):
        raise ValueError(f"a list property stands before or in its element `{element}`")
    try:
        dtype = np.dtype([(name, order + kind) for name, kind in each.columns])
    except ValueError:
        raise ValueError(f"element `{element}` has two properties of one name") from None
    if not order:
        return _rows(data[start:], sum(other.count for other in before), each, dtype), comments
    offset = start + sum(other.count * np.dtype([(n, k) for n, k in other.columns]).itemsize for other in before)
    if len(data) < offset + each.count * dtype.itemsize:
        held = max(len(data) - offset, 0) // max(dtype.itemsize, 1)
        raise ValueError(f"it is cut short: {held:,} of {each.count:,} rows of `{element}`")
    table = np.frombuffer(data, dtype, each.count, offset)
    return table.astype(dtype.newbyteorder("=")), comments


def written(table: np.ndarray, comments: tuple[str, ...] = (), *, element: str = "vertex", text: bool = False) -> bytes:
    """A PLY file of one element.

    Args:
        table: Structured array (N,).
        comments: Lines of the header, in ASCII.
        element: Its name.
        text: ASCII instead of little-endian binary; floats keep all their digits.
    """
    kinds = {name: _NAMES[table.dtype[name].str[1:]] for name in table.dtype.names or ()}
    lines = ["ply", f"format {'ascii' if text else 'binary_little_endian'} 1.0"]
    lines += [f"comment {line}" for line in comments]
    lines += [f"element {element} {len(table)}"]
    lines += [f"property {kind} {name}" for name, kind in kinds.items()]
    head = "\n".join([*lines, "end_header\n"]).encode("ascii")
    if not text:
        return head + table.astype(table.dtype.newbyteorder("<")).tobytes()
    body = io.BytesIO()
    digits = {"float": "%.9g", "double": "%.17g"}
    np.savetxt(body, table, fmt=" ".join(digits.get(kind, "%d") for kind in kinds.values()))
    return head + body.getvalue()


def _header(data: bytes) -> tuple[str, list[_Element], tuple[str, ...], int]:
    """Byte order ("" for ASCII), elements, comments and the offset of the data."""
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    stop = data.find(b"\n", end)
    if not data.startswith(b"ply") or end < 0 or stop < 0:
        raise ValueError("it does not begin with a PLY header")
    order: str | None = None
    elements: list[_Element] = []
    comments = []
    for line in data[3:end].decode("latin-1").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "format":
            order = _ORDERS.get(rest.split()[0] if rest else "")
        elif word == "comment":
            comments.append(rest)
        elif word == "element":
            elements.append(_element(rest))
        elif word == "property":
            _add(elements, rest.split())
    if order is None:
        raise ValueError("its header names no known encoding")
    return order, elements, tuple(comments), stop + 1


def _element(rest: str) -> _Element:
    name, _, count = rest.partition(" ")
    if not count.strip().isdecimal():
        raise ValueError(f"element `{name}` has no number of rows")
    return _Element(name, int(count))


def _add(elements: list[_Element], words: list[str]) -> None:
    if not elements or len(words) < 2:
        raise ValueError("a property of its header belongs to no element")
    if words[0] == "list":
        elements[-1].has_lists = True
    elif words[0] in _TYPES:
        elements[-1].columns.append((words[1], _TYPES[words[0]]))
    else:
        raise ValueError(f"property `{words[1]}` is of the unknown type `{words[0]}`")


def _rows(body: bytes, skipped: int, element: _Element, dtype: np.dtype) -> np.ndarray:
    lines = body.decode("latin-1").splitlines()[skipped : skipped + element.count]
    words = [word for line in lines for word in line.split()]
    if len(words) != element.count * len(element.columns):
        raise ValueError(f"it is cut short: {len(lines):,} of {element.count:,} rows of `{element.name}`")
    try:
        numbers = np.array(words, np.float64).reshape(element.count, len(element.columns))
    except ValueError:
        raise ValueError(f"a row of `{element.name}` holds something that is no number") from None
    table = np.empty(element.count, dtype)
    for (name, kind), column in zip(element.columns, numbers.T, strict=True):
        if kind[0] != "f" and not (_fits(column, kind) and (column == np.round(column)).all()):
            raise ValueError(f"property `{name}` holds numbers that are no {_NAMES[kind]}")
        table[name] = column
    return table


def _fits(column: np.ndarray, kind: str) -> bool:
    limits = np.iinfo(kind)
    return bool(np.isfinite(column).all() and (column >= limits.min).all() and (column <= limits.max).all())
