"""Points of `scene.yaml` in the regions of proposals: one element joins regions, several divide one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.errors import RuleError
from dextera_build.geometry.regions import box_of

from ..overlap import Box, around, box_area
from .naming import unique
from .scene_file import Point, Wanted

NEAR_PX = 4
"""Largest distance of a point from its region [px]: masks lack smeared borders and have holes."""
Divide = Callable[[np.ndarray, Sequence[Sequence[Point]]], np.ndarray]
"""Divides a region (H, W) bool between lists of points: (H, W) int32, 1 for the first list, ...; 0 outside."""


def region_at(regions: np.ndarray, point: Point) -> int:
    """The region of (H, W) int32 with most pixels around a point; 0 if none is near."""
    column, row = point
    near = regions[max(0, row - NEAR_PX) : row + NEAR_PX + 1, max(0, column - NEAR_PX) : column + NEAR_PX + 1]
    counts = np.bincount(near[near > 0])
    return int(counts.argmax()) if len(counts) else 0


def finder(regions: np.ndarray | None) -> Callable[[Point], Box | None] | None:
    """Finds the box of the region at a point; None without regions."""
    if regions is None:
        return None

    def find(point: Point) -> Box | None:
        number = region_at(regions, point)
        return box_of(regions == number) if number else None

    return find


def box_at(proposals: Sequence[Element], point: Point) -> Element | None:
    """The proposal with the smallest box around a point."""
    column, row = point
    holding = [p for p in proposals if p.box and p.box[0] <= column < p.box[2] and p.box[1] <= row < p.box[3]]
    return min(holding, key=lambda p: box_area(p.box or (0, 0, 0, 0)), default=None)


def settled(wanted: Sequence[Wanted], proposed: Elements, divide: Divide) -> Elements:
    """The proposals after all points count: of each element with points, there is one proposal.

    A region with points of several elements is divided between them. All regions with points of one element are
    joined, and so are proposals without regions.

    Args:
        wanted: Elements of the file.
        proposed: Proposals of a backend.
        divide: Divides regions.

    Raises:
        RuleError: One of several points of an element is in no region, or a part of a divided region is empty.
    """
    if proposed.regions is None:
        return proposed.model_copy(update={"elements": _joined_boxes(wanted, proposed.elements)})
    places = {item.name: [region_at(proposed.regions, point) for point in item.points] for item in wanted}
    for item in wanted:
        if len(item.points) > 1 and 0 in places[item.name]:
            point = item.points[places[item.name].index(0)]
            raise _nowhere(item, point)
    regions, elements = proposed.regions.copy(), list(proposed.elements)
    for number in np.unique(regions[regions > 0]):
        sharing = [item for item in wanted if number in places[item.name]]
        if len(sharing) > 1:
            elements = _divided(sharing, places, int(number), regions, elements, divide)
    for item in wanted:
        chosen = list(dict.fromkeys(places[item.name]))
        if len(chosen) > 1:
            elements = _joined(chosen, regions, elements)
    return proposed.model_copy(update={"elements": tuple(elements), "regions": _from_largest(regions)})


def _divided(
    sharing: Sequence[Wanted],
    places: dict[str, list[int]],
    number: int,
    regions: np.ndarray,
    elements: list[Element],
    divide: Divide,
) -> list[Element]:
    """Divide a region: its parts get numbers in `regions` and `places`, and copies of its proposal."""
    region = regions == number
    own = [[p for p, at in zip(item.points, places[item.name], strict=True) if at == number] for item in sharing]
    parts = divide(region, own)
    known = _of_region(region, elements)
    rest = [element for element in elements if element is not known]
    taken = {element.name for element in rest}
    for part, item in enumerate(sharing, start=1):
        mask = region & (parts == part)
        if not mask.any():
            raise _nowhere(item, own[part - 1][0], "its part of the region is empty, because another point is as near")
        mine = number if part == 1 else int(regions.max()) + 1
        regions[mask] = mine
        places[item.name] = [mine if at == number else at for at in places[item.name]]
        if known is not None:
            rest.append(known.model_copy(update={"name": unique(known.name, taken), "box": box_of(mask)}))
    return rest


def _joined(chosen: Sequence[int], regions: np.ndarray, elements: list[Element]) -> list[Element]:
    """Join regions under the first number; the largest one's proposal stays."""
    masks = {number: regions == number for number in chosen}
    found = [
        (int(mask.sum()), element) for mask in masks.values() if (element := _of_region(mask, elements)) is not None
    ]
    joined = np.logical_or.reduce(list(masks.values()))
    regions[joined] = chosen[0]
    if not found:
        return elements
    kept = max(found, key=lambda pair: pair[0])[1]
    gone = [element for _, element in found if element is not kept]
    box = box_of(joined)
    return [
        e.model_copy(update={"box": box}) if e is kept else e for e in elements if not any(e is each for each in gone)
    ]


def _of_region(mask: np.ndarray, elements: Sequence[Element]) -> Element | None:
    box = box_of(mask)
    return next((element for element in elements if element.box == box), None)


def _joined_boxes(wanted: Sequence[Wanted], proposals: Sequence[Element]) -> tuple[Element, ...]:
    """The proposals, those that the points of one element choose as one in the box around them."""
    found = list(proposals)
    for item in (each for each in wanted if len(each.points) > 1):
        chosen: list[Element] = []
        for point in item.points:
            proposal = box_at(proposals, point)
            if proposal is None:
                raise _nowhere(item, point)
            chosen += [] if any(proposal is each for each in chosen) else [proposal]
        if len(chosen) > 1:
            box: Box = around([each.box for each in chosen if each.box])
            joined = chosen[0].model_copy(update={"box": box})
            found = [joined if p is chosen[0] else p for p in found if not any(p is each for each in chosen[1:])]
    return tuple(found)


def _from_largest(regions: np.ndarray) -> np.ndarray:
    """The regions, numbered from the largest."""
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    order = [number for number in np.argsort(-sizes, kind="stable") if sizes[number]]
    numbers = np.zeros(len(sizes), np.int32)
    numbers[order] = np.arange(1, len(order) + 1)
    return np.asarray(numbers[regions])


def _nowhere(item: Wanted, point: Point, why: str = "nothing that stands out from the support is there") -> RuleError:
    return RuleError(
        f"the point {list(point)} of `{item.name}` counts for nothing: {why}",
        code="DXB-B204",
        where=item.place,
        hint="choose another pixel, in the middle of the part that belongs to it: [column, row]",
    )
