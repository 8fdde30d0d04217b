"""Differences between two stored artifacts, from their headers and blobs, without knowledge of any type.

Both are traversed in parallel, skipping parts with equal digests. A difference of arrays gives their forms, the number
of differing values and the largest difference; tables are compared by rows and columns.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from dextera_build.artifacts.core.identity import parse

if TYPE_CHECKING:
    from dextera_build.artifacts.comparison.motion import Motion

Get = Callable[[str], bytes]
Kind: TypeAlias = Literal["array", "number", "pose", "bytes", "value", "added", "removed", "type"]
_WIDE = 60


@dataclass(frozen=True)
class Difference:
    """One field that differs."""

    path: str
    """`vertices`, `bodies[mug].mesh.faces`, `rows[mug].height`; "" for the whole."""
    kind: Kind
    old: str
    new: str
    largest: float | None = None
    """Largest absolute difference of two numbers, infinite if one of them is not finite; None if forms differ."""
    changed: int = 0
    """Number of values that differ."""
    total: int = 0
    motion: Motion | None = None
    """Motion between two poses."""

    @property
    def field(self) -> str:
        """The path without labels and indices: `bodies.mesh.faces`."""
        return "".join(part.partition("]")[2] if i else part for i, part in enumerate(self.path.split("[")))

    def __str__(self) -> str:
        """The change in one line."""
        if self.motion is not None:
            return str(self.motion)
        if self.largest is None:
            return {"added": self.new, "removed": self.old}.get(self.kind, f"{self.old} -> {self.new}")
        if self.kind == "number":
            return f"{self.old} -> {self.new}, by {self.largest:.3g}"
        return f"{self.old}: {self.changed:,} of {self.total:,} differ, by {self.largest:.3g} at most"


def differences(old: str, new: str, get: Get, *, motions: bool = True) -> list[Difference]:
    """Every field that differs between the artifacts whose headers have these digests, in the order of the fields.

    Args:
        old: Digest of one header.
        new: Digest of the other.
        get: Returns the bytes of a blob.
        motions: Tell by the motion between them how matrix and covariance of two poses differ; False: by the numbers.
    """
    found: list[Difference] = []
    stack: list[tuple[str, Any, Any]] = [("", {"$ref": old}, {"$ref": new})]
    while stack:
        path, before, after = stack.pop()
        if before == after and _spelled(before) == _spelled(after):
            continue
        motion, inner = _motion(before, after, get) if motions else None, _inside(path, before, after, get)
        if motion is not None:
            found.append(Difference(path, "pose", "", "", motion.distance_m, 1, 1, motion))
            inner = [part for part in inner or () if part[0].rpartition(".")[2] not in _MOVED]
        if inner is None:
            found.append(_differ(path, before, after, get))
        else:
            stack += reversed(inner)
    return [difference for difference in found if difference.changed or difference.largest is None]


def _motion(old: Any, new: Any, get: Get) -> Motion | None:
    """The motion between two poses of the same frames, if their matrices differ."""
    if not _tag(old) == _tag(new) == "$ref":
        return None
    kinds = [parse(json.loads(get(side["$ref"]))["artifact"])[0] for side in (old, new)]
    if kinds[0] != kinds[1] or kinds[0] not in _POSES:
        return None
    from dextera_build.artifacts.comparison import motion

    found = motion.between(*(motion.KINDS[kinds[0]].decode(side["$ref"], get) for side in (old, new)))
    return found if found is not None and (found.distance_m or found.angle_deg) else None


_POSES = ("Pose", "Similarity")
_MOVED = ("matrix", "covariance")
"""Fields of poses that a motion summarises."""
_GONE = object()
_Triples: TypeAlias = list[tuple[str, Any, Any]]


def _spelled(value: Any) -> str:
    # 1 and 1.0 are equal in Python, but not in a header.
    return json.dumps(value)


def _inside(path: str, old: Any, new: Any, get: Get) -> _Triples | None:
    """The parts of two values of the same form, or None if they are compared as a whole."""
    tag = _tag(old)
    if _GONE in (old, new) or tag != _tag(new):
        return None
    if tag == "$ref":
        one, two = json.loads(get(old["$ref"])), json.loads(get(new["$ref"]))
        kinds = [side["artifact"] for side in (one, two)]
        other: _Triples = [] if kinds[0] == kinds[1] else [(path, *kinds)]
        if parse(kinds[0])[0] != parse(kinds[1])[0]:
            return other
        if kinds == ["Table", "Table"]:
            return _table(path, one["fields"], two["fields"])
        return other + _pairs(one["fields"], two["fields"], lambda name: f"{path}.{name}" if path else name)
    if tag == "$value":
        return _pairs(old[tag], new[tag], lambda name: f"{path}.{name}" if path else name)
    if tag == "$map":
        return _pairs(old[tag], new[tag], lambda name: f"{path}[{name}]")
    if tag == "list":
        one, two = (dict(enumerate(side)) for side in (old, new))
        return _pairs(one, two, lambda index: f"{path}[{index}]")
    return None


def _pairs(old: Mapping[Any, Any], new: Mapping[Any, Any], name: Callable[[Any], str]) -> _Triples:
    return [(name(key), old.get(key, _GONE), new.get(key, _GONE)) for key in dict.fromkeys([*old, *new])]


def _table(path: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> _Triples:
    """Cells by the names of row and column; rows are named by their first cells if these are unique."""
    plain = [{name: value for name, value in side.items() if name != "rows"} for side in (old, new)]
    found = _pairs(plain[0], plain[1], lambda name: f"{path}.{name}" if path else name)
    sides = [_rows(side) for side in (old, new)]
    for row in dict.fromkeys([*sides[0], *sides[1]]):
        place = f"{path}.rows[{row}]" if path else f"rows[{row}]"
        if row in sides[0] and row in sides[1]:
            found += _pairs(sides[0][row], sides[1][row], lambda column, place=place: f"{place}.{column}")  # type: ignore[misc]
        else:
            found.append((place, *(list(side[row].values()) if row in side else _GONE for side in sides)))  # type: ignore[arg-type]
    return found


def _rows(table: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    columns = [column["$value"]["name"] for column in table["columns"]]
    names = [str(row[0]) if row else "" for row in table["rows"]]
    named = len(set(names)) == len(names)
    return {
        names[index] if named else str(index): dict(zip(columns, row, strict=False))
        for index, row in enumerate(table["rows"])
    }


def _differ(path: str, old: Any, new: Any, get: Get) -> Difference:
    if old is _GONE or new is _GONE:
        return Difference(path, "added" if old is _GONE else "removed", _short(old), _short(new))
    if _tag(old) == _tag(new) == "$array":
        return _arrays(path, old["$array"], new["$array"], get)
    if _is_number(old) and _is_number(new):
        return Difference(path, "number", *_rounded(old, new), abs(float(new) - float(old)), 1, 1)
    kind: Kind = "bytes" if _tag(old) == _tag(new) == "$bytes" else "value" if _tag(old) == _tag(new) else "type"
    return Difference(path, kind, _short(old), _short(new))


def _arrays(path: str, old: Sequence[Any], new: Sequence[Any], get: Get) -> Difference:
    forms = [f"{dtype} ({', '.join(map(str, shape))})" for dtype, shape, _ in (old, new)]
    one, two = (np.frombuffer(get(blob), dtype=np.dtype(dtype)).reshape(shape) for dtype, shape, blob in (old, new))
    if forms[0] != forms[1]:
        shown = [form + _bounds(side) for form, side in zip(forms, (one, two), strict=True)]
        return Difference(path, "array", shown[0], shown[1])
    apart = distance(one, two)
    # Equal numbers with different bytes: a negative zero, another NaN.
    changed = int(np.count_nonzero(apart)) or _other_bytes(one, two)
    largest = float(apart.max()) if apart.size else 0.0
    return Difference(path, "array", forms[0], forms[1], largest, changed, int(apart.size))


def distance(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Absolute difference of each number; infinite if only one is NaN, zero if both are."""
    with np.errstate(invalid="ignore", over="ignore"):
        apart = np.abs(one.astype(np.float64) - two.astype(np.float64))
    # Includes equal infinities, and long integers that are equal as floats.
    apart[one == two] = 0.0
    apart[(one != two) & (apart == 0.0)] = np.finfo(np.float64).tiny
    if one.dtype.kind == "f":
        nan = np.isnan(one).astype(int) + np.isnan(two).astype(int)
        apart[nan == 1] = np.inf
        apart[nan == 2] = 0.0
    return apart


def _other_bytes(one: np.ndarray, two: np.ndarray) -> int:
    raw = [side.reshape(-1).view(np.uint8).reshape(side.size, -1) for side in (one, two)]
    return int(np.count_nonzero((raw[0] != raw[1]).any(axis=1)))


def _bounds(points: np.ndarray) -> str:
    """Bounds of an array that resembles points."""
    if points.ndim != 2 or points.shape[1] not in (2, 3) or points.dtype.kind != "f" or not len(points):
        return ""
    low, high = (", ".join(f"{value:.4g}" for value in edge) for edge in (points.min(axis=0), points.max(axis=0)))
    return f" within ({low}) and ({high})"


def _tag(value: Any) -> str:
    if isinstance(value, dict):
        return str(next(iter(value)))
    return "list" if isinstance(value, list) else "plain"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _rounded(old: float, new: float) -> tuple[str, str]:
    """Two numbers with six digits, or with as many as show that they differ."""
    if isinstance(old, int) and isinstance(new, int):
        return str(old), str(new)
    texts = f"{old:.6g}", f"{new:.6g}"
    return texts if texts[0] != texts[1] else (_short(old), _short(new))


def _short(value: Any) -> str:
    if value is _GONE:
        return ""
    if _tag(value) == "$array":
        dtype, shape, _ = value["$array"]
        return f"{dtype} ({', '.join(map(str, shape))})"
    if _tag(value) == "$bytes":
        return f"{value['$bytes'][1]:,} bytes {value['$bytes'][0][:8]}"
    if _tag(value) == "$ref":
        return f"artifact {value['$ref'][:8]}"
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= _WIDE else f"{text[: _WIDE - 3]}..."


def by_field(found: Sequence[Difference]) -> dict[str, float | None]:
    """Field -> largest difference in it, over all labels; None if the forms differ."""
    fields: dict[str, float | None] = {}
    for difference in found:
        known = fields.get(difference.field, 0.0)
        fields[difference.field] = (
            None if known is None or difference.largest is None else max(known, difference.largest)
        )
    return fields
