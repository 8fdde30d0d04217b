"""`scene.yaml`: a hand-written list of elements, parsed strictly and matched to geometric proposals."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, get_args

from dextera_build.artifacts.object import Element
from dextera_build.errors import Place, RuleError, did_you_mean, listing
from dextera_build.geometry.materials import TABLE

from ..masks.overlap import box_iou
from . import joints_file
from .joints_file import FILE
from .joints_file import box as _box
from .joints_file import mapping as _mapping
from .joints_file import wrong as _wrong
from .naming import unique

FIELDS = ("name", "phrase", "category", "body_type", "material", "box", "interactive", "joints")
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


def match(wanted: Sequence[Wanted], proposals: Sequence[Element], smallest_iou: float) -> tuple[Element, ...]:
    """Assign each wanted element the box of the matching proposal; unmatched proposals become static.

    Boxes match by overlap, phrases by the colour and shape words shared with a proposal.

    Raises:
        RuleError: An interactive element matches no proposal.
    """
    free = list(proposals)
    chosen: dict[str, Element | None] = {}
    # Boxes are unambiguous and match first; phrases follow in file order.
    for item in sorted(wanted, key=lambda w: "box" not in w.fields):
        proposal = _by_box(item, free, smallest_iou) if "box" in item.fields else _by_words(item, free)
        if proposal is None and (item.interactive or "box" in item.fields):
            raise RuleError(
                f"`{item.name}` matches nothing that stands out from the support",
                code="DXB-B204",
                where=item.place,
                facts={
                    "wanted": item.fields.get("box") or item.fields.get("phrase") or item.name,
                    "proposals": "; ".join(f"{p.name} {list(p.box or ())}" for p in proposals) or "none",
                    "taken": listing(p.name for p in proposals if p not in free),
                },
                hint="give it the `box` of one of the proposals: [left, top, right, bottom] in pixels",
            )
        if proposal is not None:
            free.remove(proposal)
        chosen[item.name] = proposal
    named = [_merged(item, chosen[item.name]) for item in wanted]
    taken = {element.name for element in named}
    rest = [p.model_copy(update={"name": unique(p.name, taken), "interactive": False}) for p in free]
    return (*named, *rest)


def boxed(wanted: Sequence[Wanted]) -> tuple[Element, ...]:
    """The elements as the file has them, without proposals to match.

    Raises:
        RuleError: An interactive element has no box.
    """
    for item in wanted:
        if item.interactive and "box" not in item.fields:
            raise RuleError(
                f"`{item.name}` has no box",
                code="DXB-B204",
                where=item.place,
                hint="give it the `box` of its pixels: [left, top, right, bottom], right and bottom excluded",
            )
    return tuple(_merged(item, None) for item in wanted)


def _by_box(item: Wanted, free: Sequence[Element], smallest_iou: float) -> Element | None:
    box = item.fields["box"]
    scored = [(box_iou(box, p.box), p) for p in free if p.box is not None]
    best = max(scored, key=lambda s: s[0], default=None)
    return best[1] if best is not None and best[0] >= smallest_iou else None


def _by_words(item: Wanted, free: Sequence[Element]) -> Element | None:
    text = f"{item.fields.get('phrase', '')} {item.name} {item.fields.get('category', '')}"
    words = set(re.findall(r"[a-z]+", text.lower()))
    scored = [(len(words & set(re.findall(r"[a-z]+", f"{p.phrase} {p.category}"))), p) for p in free]
    best = max((score for score, _ in scored), default=0)
    fitting = [p for score, p in scored if score == best]
    return fitting[0] if best > 0 and len(fitting) == 1 else None


def _merged(item: Wanted, proposal: Element | None) -> Element:
    given = dict(item.fields)
    base: dict[str, Any] = {"category": "object", "phrase": item.name.replace("_", " ")}
    if proposal is not None:
        base = {key: getattr(proposal, key) for key in ("category", "body_type", "material", "box", "phrase")}
    if "category" in given and "body_type" not in given:
        given["body_type"] = "articulated" if given["category"] == "laptop" else "rigid"
    if given.get("joints"):
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
