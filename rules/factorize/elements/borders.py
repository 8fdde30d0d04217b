"""Warnings about elements that the picture's border cuts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dextera_build.artifacts.objects.object import Element
from dextera_build.errors import listing

from ..overlap import Box
from ..regions.borders import BAND


def doubts(elements: Sequence[Element], size: tuple[int, int]) -> Iterator[str]:
    """A warning for each element that is cut: how its body is completed, or why it has none.

    Args:
        elements: Elements of the photograph.
        size: Its width and height [px].
    """
    for element in elements:
        if element.cut and element.box:
            where = f"the {listing(sides(element.box, size))} border of the picture cuts"
            if element.interactive:
                yield f"{where} {element.name}: what is outside the picture is completed by symmetry"
            else:
                yield (
                    f"{where} the {element.phrase} in the box {list(element.box)}, and too little of it is in view to "
                    "make a body: it stays in the background; move the camera to see it whole"
                )


def sides(box: Box, size: tuple[int, int]) -> list[str]:
    """Sides of a picture of `size` (width, height) that a box touches."""
    left, top, right, bottom = box
    near = {"left": left, "top": top, "right": size[0] - right, "bottom": size[1] - bottom}
    return [side for side, distance in near.items() if distance < BAND]
