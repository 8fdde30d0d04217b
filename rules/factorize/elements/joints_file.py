"""Joints stated in `scene.yaml`, and helpers for parsing its other parts."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from dextera_build.artifacts.objects.object import JointHint
from dextera_build.errors import Place, RuleError, did_you_mean, listing

FILE = "$scene"
"""The path of the file as the input names it; the engine replaces it by the real path in errors."""
KINDS = {"hinge": "revolute", "slide": "prismatic"}
FIELDS = ("type", "part_px", "axis_px", "range_deg", "range_mm", "at_deg", "at_mm")


def read(node: Any) -> tuple[JointHint, ...]:
    """The joints of one element; none for `type: hinge` alone, whose axis is estimated from the shape.

    Raises:
        RuleError: They are malformed; the message gives line and column.
    """
    if node.id != "sequence" or not node.value:
        raise wrong("`joints` must list at least one joint", node, hint="begin each with `- type: hinge`")
    found = [_joint(each) for each in node.value]
    if len(found) > 1 and None in found:
        alone = node.value[found.index(None)]
        hint = "state `part_px` and `axis_px` of every joint, or one hinge alone, which is sought in the shape"
        raise wrong("a hinge without `part_px` is one of several joints", alone, hint=hint)
    return tuple(each for each in found if each is not None)


def _joint(node: Any) -> JointHint | None:
    """A joint as stated in the file; None for a hinge without further properties."""
    fields = mapping(node, FIELDS)
    if "type" not in fields:
        raise wrong("a joint has no `type`", node, hint="type: hinge, part_px: [left, top, right, bottom]")
    kind = fields["type"].value
    if kind not in KINDS:
        raise wrong(
            f"`{kind}` is no joint", fields["type"], hint=did_you_mean(str(kind), tuple(KINDS)), known=listing(KINDS)
        )
    if "part_px" not in fields:
        _refuse_untold(kind, fields, node)
        return None
    unit, other = ("deg", "mm") if kind == "hinge" else ("mm", "deg")
    if strange := [name for name in fields if name.endswith(f"_{other}")]:
        hint = f"write `{strange[0].replace(other, unit)}`"
        raise wrong(f"a {kind} has no `{strange[0]}`", fields[strange[0]], hint=hint)
    if kind == "hinge" and "axis_px" not in fields:
        raise wrong("a hinge has no `axis_px`", node, hint="give two pixels on its axis: axis_px: [[x, y], [x, y]]")
    scale = math.pi / 180.0 if kind == "hinge" else 0.001
    limits = _limits(fields.get(f"range_{unit}"))
    at = _numbers(fields[f"at_{unit}"], 1)[0] if f"at_{unit}" in fields else 0.0
    if limits is not None and not limits[0] <= at <= limits[1]:
        hint = f"`at_{unit}` is its position in the photograph, 0 unless given"
        raise wrong(f"the joint is at {at:g} {unit}, outside its range", node, hint=hint, range=list(limits))
    return JointHint(
        type="revolute" if kind == "hinge" else "prismatic",
        part_px=box(fields["part_px"], "part_px"),
        axis_px=_axis(fields.get("axis_px")),
        range=None if limits is None else (limits[0] * scale, limits[1] * scale),
        position=at * scale,
    )


def _refuse_untold(kind: str, fields: dict[str, Any], node: Any) -> None:
    """Raise if `part_px` is missing, unless the entry is a hinge without further properties."""
    if kind != "hinge":
        hint = "a shut drawer looks like a wall: give the box of its front, part_px: [left, top, right, bottom]"
        raise wrong(f"a {kind} has no `part_px`", node, hint=hint)
    if others := [name for name in fields if name != "type"]:
        hint = "give part_px: [left, top, right, bottom] and axis_px, or `type: hinge` alone: then it is sought"
        raise wrong(f"a hinge has `{others[0]}` but no `part_px`", fields[others[0]], hint=hint)


def _limits(node: Any) -> tuple[float, float] | None:
    if node is None:
        return None
    low, high = _numbers(node, 2)
    if low >= high:
        raise wrong("the range is empty", node, hint="lower limit first: [0, 90]")
    return low, high


def _axis(node: Any) -> tuple[tuple[float, float], tuple[float, float]] | None:
    if node is None:
        return None
    if node.id != "sequence" or len(node.value) != 2:
        raise wrong("`axis_px` must be two pixels: [[x, y], [x, y]]", node)
    first, second = (_numbers(each, 2) for each in node.value)
    if math.dist(first, second) < 2.0:
        raise wrong("the two pixels of `axis_px` are one", node, hint="take them far apart")
    return (first[0], first[1]), (second[0], second[1])


def _numbers(node: Any, count: int) -> list[float]:
    parts = [node] if count == 1 else node.value if node.id == "sequence" else []
    texts = [part.value if part.id == "scalar" else "" for part in parts]
    if len(texts) != count or not all(re.fullmatch(r"-?\d+(\.\d+)?", text) for text in texts):
        raise wrong(f"{'a number' if count == 1 else f'{count} numbers'} belong{'s' * (count == 1)} here", node)
    return [float(text) for text in texts]


def mapping(node: Any, known: Sequence[str]) -> dict[str, Any]:
    """Key -> node of a YAML mapping with known keys."""
    import yaml

    if not isinstance(node, yaml.MappingNode):
        raise wrong(f"a mapping with {listing(known)} belongs here", node)
    found: dict[str, Any] = {}
    for key, value in node.value:
        if key.id != "scalar":
            raise wrong("a field's name is a word", key, known=listing(known))
        if key.value in found:
            raise wrong(f"`{key.value}` is given twice", key)
        if key.value not in known:
            hint = did_you_mean(str(key.value), known)
            raise wrong(f"`{key.value}` is not known here", key, hint=hint, known=listing(known))
        found[key.value] = value
    return found


def box(node: Any, name: str = "box") -> tuple[int, int, int, int]:
    """left, top, right, bottom [px]."""
    parts = [part.value for part in node.value] if node.id == "sequence" else []
    if len(parts) != 4 or not all(isinstance(p, str) and re.fullmatch(r"\d+", p) for p in parts):
        raise wrong(f"`{name}` must be four whole numbers: [left, top, right, bottom] in pixels", node)
    left, top, right, bottom = (int(part) for part in parts)
    if left >= right or top >= bottom:
        raise wrong(
            f"`{name}` is empty", node, box=f"[{left}, {top}, {right}, {bottom}]", hint="left < right, top < bottom"
        )
    return left, top, right, bottom


def wrong(message: str, node: Any, *, hint: str | None = None, **facts: object) -> RuleError:
    """The error about a node, with line and column."""
    mark = getattr(node, "start_mark", None)
    place = Place(FILE, mark.line + 1, mark.column + 1) if mark is not None else Place(FILE)
    return RuleError(message, code="DXB-B203", where=place, hint=hint, facts=facts)
