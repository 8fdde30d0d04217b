"""`scene.yaml`: a hand-written list of elements, parsed strictly and matched to proposals."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, get_args

from dextera_build.artifacts.object import Element
from dextera_build.errors import Place, RuleError, did_you_mean, listing
from dextera_build.geometry.materials import TABLE

from ..masks.overlap import Box, box_area, box_iou
from . import joints_file
from .joints_file import FILE
from .joints_file import box as _box
from .joints_file import mapping as _mapping
from .joints_file import wrong as _wrong
from .naming import unique

FIELDS = ("name", "phrase", "category", "body_type", "material", "at_px", "box", "interactive", "joints")
CATEGORIES = ("box", "cylinder", "bowl", "mug", "laptop", "object", "support", "robot", "room")
STATIC = ("support", "robot", "room")
BODY_TYPES = get_args(Element.model_fields["body_type"].annotation)
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
    def interactive(self) -> bool:
        """Whether the element is a handled object."""
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
        raise _wrong(f"`{FILE}` is nested too deeply", None) from None
    except UnicodeDecodeError as error:
        raise _wrong(f"`{FILE}` is not UTF-8 text", None, reader=error) from None
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


Find = Callable[[tuple[int, int]], Box | None]
"""The box of the proposal that has a pixel (column, row); None if none has."""


def match(
    wanted: Sequence[Wanted], proposals: Sequence[Element], smallest_iou: float, at: Find | None = None
) -> tuple[Element, ...]:
    """Give each wanted element the box of its proposal; proposals that no element takes become static.

    A point matches the proposal that has its pixel, a box the one that overlaps it most, and a phrase the only one
    that shares most of its words of colour and shape.

    Args:
        wanted: Entries of the file.
        proposals: What a backend proposes.
        smallest_iou: Overlap (IoU) below which boxes are those of different things.
        at: Looks up pixels in the masks of the proposals; without it, the smallest box with the point is taken.

    Raises:
        RuleError: An interactive element, or one with a point or a box, matches no proposal or several.
    """
    free = list(proposals)
    chosen: dict[str, Element | None] = {}
    # Points and boxes are unambiguous and match first; phrases follow in file order.
    for item in sorted(wanted, key=lambda w: ("at_px" not in w.fields, "box" not in w.fields)):
        fitting = _fitting(item, free, smallest_iou, at)
        placed = "at_px" in item.fields or "box" in item.fields
        if len(fitting) != 1 and (item.interactive or placed):
            raise _unmatched(item, proposals, free, fitting)
        chosen[item.name] = fitting[0] if len(fitting) == 1 else None
        free = [p for p in free if p is not chosen[item.name]]
    named = [_merged(item, chosen[item.name]) for item in wanted]
    taken = {element.name for element in named}
    rest = [p.model_copy(update={"name": unique(p.name, taken), "interactive": False}) for p in free]
    return (*named, *rest)


def _unmatched(
    item: Wanted, proposals: Sequence[Element], free: Sequence[Element], fitting: Sequence[Element]
) -> RuleError:
    sought = next(
        (f"{key} {list(item.fields[key])}" for key in ("at_px", "box") if key in item.fields),
        item.fields.get("phrase") or item.name,
    )
    taken = [p.name for p in proposals if p not in free]
    found = "nothing that stands out from the support"
    if fitting:
        found = f"{len(fitting)} things equally: {listing(p.name for p in fitting)}"
    return RuleError(
        f"`{item.name}` matches {found}",
        code="DXB-B204",
        where=item.place,
        facts={
            "wanted": sought,
            "proposals": "; ".join(f"{p.name} {list(p.box or ())}" for p in proposals) or "none",
            **({"taken": listing(taken)} if taken else {}),
        },
        hint="give it `at_px: [column, row]`, a pixel of the right one; the numbers above are boxes [left, top, right, "
        "bottom] of the proposals; the preview of `parse` in the report shows them",
    )


def boxed(wanted: Sequence[Wanted]) -> tuple[Element, ...]:
    """The elements as the file has them, without proposals to match.

    Raises:
        RuleError: An interactive element has no box.
    """
    for item in wanted:
        if item.interactive and "box" not in item.fields:
            raise RuleError(
                f"`{item.name}` has no box" + (": nothing is proposed at its point" if "at_px" in item.fields else ""),
                code="DXB-B204",
                where=item.place,
                hint="give it the `box` of its pixels: [left, top, right, bottom], right and bottom excluded",
            )
    return tuple(_merged(item, None) for item in wanted)


def inside(wanted: Sequence[Wanted], width: int, height: int) -> None:
    """Refuse points and boxes outside a photograph of this size [px].

    Raises:
        RuleError: One is.
    """
    for item in wanted:
        column, row = item.fields.get("at_px") or item.fields.get("box", (0, 0))[:2]
        if column >= width or row >= height:
            key = "at_px" if "at_px" in item.fields else "box"
            raise RuleError(
                f"`{key}` of `{item.name}` is outside the photograph",
                code="DXB-B204",
                where=item.place,
                facts={key: str(list(item.fields[key])), "photograph": f"{width} x {height} px"},
                hint="count pixels of the photograph as it is built, column first: `dxb new scene` writes some",
            )


def _fitting(item: Wanted, free: Sequence[Element], smallest_iou: float, at: Find | None) -> list[Element]:
    if "at_px" in item.fields:
        return _by_point(item.fields["at_px"], free, at)
    if "box" in item.fields:
        return _by_box(item.fields["box"], free, smallest_iou)
    return _by_words(item, free)


def _by_point(point: tuple[int, int], free: Sequence[Element], at: Find | None) -> list[Element]:
    """The proposal whose mask has the pixel, else, where masks are unknown, the one with the smallest box around it."""
    column, row = point
    holding = [p for p in free if p.box and p.box[0] <= column < p.box[2] and p.box[1] <= row < p.box[3]]
    if at is not None:
        own = at(point)
        return [p for p in holding if p.box == own]
    return sorted(holding, key=lambda p: box_area(p.box or (0, 0, 0, 0)))[:1]


def _by_box(box: Box, free: Sequence[Element], smallest_iou: float) -> list[Element]:
    scored = [(box_iou(box, p.box), p) for p in free if p.box is not None]
    best = max(scored, key=lambda s: s[0], default=None)
    return [best[1]] if best is not None and best[0] >= smallest_iou else []


def _by_words(item: Wanted, free: Sequence[Element]) -> list[Element]:
    text = f"{item.fields.get('phrase', '')} {item.name} {item.fields.get('category', '')}"
    words = set(re.findall(r"[a-z]+", text.lower()))
    scored = [(len(words & set(re.findall(r"[a-z]+", f"{p.phrase} {p.category}"))), p) for p in free]
    best = max((score for score, _ in scored), default=0)
    return [p for score, p in scored if best and score == best]


def _merged(item: Wanted, proposal: Element | None) -> Element:
    given = {key: value for key, value in item.fields.items() if key != "at_px"}
    base: dict[str, Any] = {"category": "object", "phrase": item.name.replace("_", " ")}
    if proposal is not None:
        base = {key: getattr(proposal, key) for key in ("category", "body_type", "material", "box", "phrase")}
        # How sure the material is, was judged for the category that was proposed.
        if given.get("category", proposal.category) == proposal.category:
            base["material_confidence"] = proposal.material_confidence
    if "category" in given and "body_type" not in given:
        given["body_type"] = "articulated" if given["category"] == "laptop" else "rigid"
    if "joints" in given:
        given["body_type"] = "articulated"
    if "material" in given:
        given["material_confidence"] = 1.0
    return Element(**{**base, **given, "interactive": item.interactive})


def _element(node: Any) -> Wanted:
    fields = {key: _value(key, value) for key, value in _mapping(node, FIELDS).items()}
    if "name" not in fields:
        raise _wrong("an element has no `name`", node, hint="add `name: blue_mug`")
    return Wanted(fields, Place(FILE, node.start_mark.line + 1, node.start_mark.column + 1))


def _value(key: str, node: Any) -> object:
    if key == "box":
        return _box(node)
    if key == "at_px":
        return _point(node)
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


def _point(node: Any) -> tuple[int, int]:
    parts = [part.value for part in node.value] if node.id == "sequence" else []
    if len(parts) != 2 or not all(isinstance(part, str) and re.fullmatch(r"[0-9]{1,6}", part) for part in parts):
        raise _wrong("`at_px` must be two whole numbers: [column, row] in pixels", node)
    return int(parts[0]), int(parts[1])
