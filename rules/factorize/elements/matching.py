"""Matching of the elements of `scene.yaml` with the proposals of a backend."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from dextera_build.artifacts.objects.object import Element
from dextera_build.errors import RuleError, listing

from ..overlap import PART, Box, around, box_area, box_inside, box_iou
from .naming import unique
from .points import box_at
from .scene_file import Point, Wanted

SMALL = 0.5
"""A proposal is small if its box has less than this fraction of the area of the requested box."""

Find = Callable[[Point], Box | None]
"""Box of the proposal that contains a pixel (column, row); None if there is none."""


def match(
    wanted: Sequence[Wanted], proposals: Sequence[Element], smallest_iou: float, at: Find | None = None
) -> tuple[Element, ...]:
    """Give each requested element the box of its proposal; unmatched proposals become static.

    A point matches the proposal that contains the pixel. A box matches the proposal with the largest overlap, or
    several proposals that together fill it. A phrase matches the proposal that shares most of its colour and shape
    words, if there is only one. A small proposal inside a requested box is part of that element, not static.

    Args:
        wanted: Elements of the file.
        proposals: Proposals of a backend.
        smallest_iou: Smallest IoU at which two boxes match.
        at: Looks up pixels in the masks of the proposals; without it, the smallest box around the point matches.

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
    boxes = [item.fields["box"] for item in wanted if "box" in item.fields]
    free = [p for p in free if not any(_is_part(p, box) for box in boxes)]
    named = [_merged(item, chosen[item.name]) for item in wanted]
    taken = {element.name for element in named}
    rest = [p.model_copy(update={"name": unique(p.name, taken), "interactive": False}) for p in free]
    return (*named, *rest)


def _unmatched(
    item: Wanted, proposals: Sequence[Element], free: Sequence[Element], fitting: Sequence[Element]
) -> RuleError:
    told = {"at_px": [list(point) for point in item.points], "box": list(item.fields.get("box", ()))}
    sought = next((f"{key} {_bare(at)}" for key, at in told.items() if at), item.fields.get("phrase") or item.name)
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


def _bare(at: list[Any]) -> list[Any]:
    """One point without the list around it."""
    return at[0] if len(at) == 1 else at


def boxed(wanted: Sequence[Wanted]) -> tuple[Element, ...]:
    """The elements with the boxes of the file, without matching.

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


def _fitting(item: Wanted, free: Sequence[Element], smallest_iou: float, at: Find | None) -> list[Element]:
    if "at_px" in item.fields:
        return _by_point(item.points[0], free, at)
    if "box" in item.fields:
        return _by_box(item.fields["box"], free, smallest_iou)
    return _by_words(item, free)


def _by_point(point: Point, free: Sequence[Element], at: Find | None) -> list[Element]:
    """The proposal whose mask contains the pixel or, without masks, the smallest box around it."""
    if at is not None:
        own = at(point)
        return [p for p in free if p.box == own and own is not None]
    smallest = box_at(free, point)
    return [smallest] if smallest is not None else []


def _by_box(box: Box, free: Sequence[Element], smallest_iou: float) -> list[Element]:
    scored = [(box_iou(box, p.box), p) for p in free if p.box is not None]
    best = max(scored, key=lambda s: s[0], default=None)
    if best is not None and best[0] >= smallest_iou:
        return [best[1]]
    parts = [p for p in free if p.box and box_inside(p.box, box) >= PART]
    corners = [p.box for p in parts if p.box]
    if not corners or box_iou(box, around(corners)) < smallest_iou:
        return []
    return [max(parts, key=lambda p: box_area(p.box or (0, 0, 0, 0)))]


def _is_part(proposal: Element, box: Box) -> bool:
    own = proposal.box
    return own is not None and box_inside(own, box) >= PART and box_area(own) < SMALL * box_area(box)


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
        base = {key: getattr(proposal, key) for key in ("category", "body_type", "material", "box", "phrase", "cut")}
        # The confidence of the material, and the mass, were estimated for the category of the proposal.
        if given.get("category", proposal.category) == proposal.category:
            base["material_confidence"] = proposal.material_confidence
            if given.get("material", proposal.material) == proposal.material:
                base["estimate"] = proposal.estimate
    if "category" in given and "body_type" not in given:
        given["body_type"] = "articulated" if given["category"] == "laptop" else "rigid"
    if "joints" in given:
        given["body_type"] = "articulated"
    if "material" in given:
        given["material_confidence"] = 1.0
    return Element(**{**base, **given, "interactive": item.interactive})
