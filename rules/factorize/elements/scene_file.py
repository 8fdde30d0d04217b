"""`scene.yaml`: a hand-written list of elements, parsed strictly."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, get_args

from dextera_build.artifacts.objects.object import Element
from dextera_build.errors import Place, RuleError, did_you_mean, listing
from dextera_build.geometry.materials import TABLE

from . import joints_file
from .joints_file import FILE
from .joints_file import box as _box
from .joints_file import mapping as _mapping
from .joints_file import wrong as _wrong

FIELDS = ("name", "phrase", "category", "body_type", "material", "at_px", "box", "interactive", "joints")
CATEGORIES = ("box", "cylinder", "bowl", "mug", "laptop", "object", "support", "robot", "room")
STATIC = ("support", "robot", "room")
BODY_TYPES = get_args(Element.model_fields["body_type"].annotation)
Point = tuple[int, int]
"""Column and row of a pixel [px]."""
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


class Wanted:
    """One element of the file, with its explicit fields and its position in the file."""

    def __init__(self, fields: dict[str, Any], place: Place) -> None:
        self.fields = fields
        self.place = place

    @property
    def name(self) -> str:
        """The unique name."""
        return str(self.fields["name"])

    @property
    def points(self) -> tuple[Point, ...]:
        """The pixels of `at_px`."""
        at: Any = self.fields.get("at_px", ())
        return (at,) if at and isinstance(at[0], int) else tuple(at)

    @property
    def interactive(self) -> bool:
        """Whether the element is a movable object."""
        return bool(self.fields.get("interactive", self.fields.get("category") not in STATIC))


def read(data: bytes) -> list[Wanted]:
    """Parse the elements of a `scene.yaml`.

    Raises:
        RuleError: The file is malformed; the message gives line and column.
    """
    import yaml

    try:
        root = yaml.compose(data.decode("utf-8"), Loader=yaml.SafeLoader)
    except RecursionError:
        raise _wrong("the file is nested too deeply", None) from None
    except UnicodeDecodeError as error:
        raise _wrong("the file is not UTF-8 text", None, reader=error) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = Place(FILE, mark.line + 1, mark.column + 1) if mark else Place(FILE)
        raise RuleError(f"not valid YAML: {error.problem}", code="DXB-B203", where=place) from None
    fields = _mapping(root, ("elements",)) if root is not None else {}
    entries = fields.get("elements")
    if not isinstance(entries, yaml.SequenceNode) or not entries.value:
        hint = "begin it with `elements:` and one `- name: ...` per thing"
        raise _wrong("`elements` must list at least one element", entries or root, hint=hint)
    found: list[Wanted] = []
    for node in entries.value:
        element = _element(node)
        if any(element.name == other.name for other in found):
            raise _wrong(f"the name `{element.name}` is given twice", node)
        found.append(element)
    return found


def inside(wanted: Sequence[Wanted], width: int, height: int) -> None:
    """Refuse points and boxes outside a photograph of this size [px].

    Raises:
        RuleError: One is.
    """
    for item in wanted:
        corners = item.points or (item.fields.get("box", (0, 0))[:2],)
        if any(column >= width or row >= height for column, row in corners):
            key = "at_px" if item.points else "box"
            raise RuleError(
                f"`{key}` of `{item.name}` is outside the photograph",
                code="DXB-B204",
                where=item.place,
                facts={key: str(list(item.fields[key])), "photograph": f"{width} x {height} px"},
                hint="count pixels of the built photograph, column first: `dxb new scene` writes some",
            )


def _element(node: Any) -> Wanted:
    fields = {key: _value(key, value) for key, value in _mapping(node, FIELDS).items()}
    if "name" not in fields:
        raise _wrong("an element has no `name`", node, hint="add `name: blue_mug`")
    return Wanted(fields, Place(FILE, node.start_mark.line + 1, node.start_mark.column + 1))


def _value(key: str, node: Any) -> object:
    if key == "box":
        return _box(node)
    if key == "at_px":
        return _points(node)
    if key == "joints":
        return joints_file.read(node)
    text = node.value if node.id == "scalar" else None
    if not isinstance(text, str) or not text:
        raise _wrong(f"`{key}` must be a word or a phrase", node)
    if key == "interactive":
        if text not in ("true", "false"):
            raise _wrong("`interactive` must be `true` or `false`", node, found=text)
        return text == "true"
    if key == "name" and not NAME.fullmatch(text):
        raise _wrong(f"`{text}` is not a name", node, hint="use lower case letters and digits joined by `_`")
    choices = {"category": CATEGORIES, "body_type": BODY_TYPES, "material": tuple(TABLE)}.get(key)
    if choices is not None and text not in choices:
        raise _wrong(f"`{text}` is not a {key}", node, hint=did_you_mean(text, choices), known=listing(choices))
    return text


def _points(node: Any) -> Point | tuple[Point, ...]:
    """One point, or several of one thing."""
    parts = node.value if node.id == "sequence" else []
    if parts and all(part.id == "sequence" for part in parts):
        return tuple(_point(part) for part in parts)
    return _point(node)


def _point(node: Any) -> Point:
    parts = [part.value for part in node.value] if node.id == "sequence" else []
    if len(parts) != 2 or not all(isinstance(part, str) and re.fullmatch(r"[0-9]{1,6}", part) for part in parts):
        hint = "of one thing that was found as several: [[column, row], [column, row]], a pixel of each"
        raise _wrong("`at_px` must be two whole numbers: [column, row] in pixels", node, hint=hint)
    return int(parts[0]), int(parts[1])
