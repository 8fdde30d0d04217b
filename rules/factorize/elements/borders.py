"""Warnings about elements that stay in the background because the picture's border cuts them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dextera_build.artifacts.objects.object import Element
from dextera_build.errors import listing

from ..regions.borders import sides


def doubts(elements: Sequence[Element], size: tuple[int, int]) -> Iterator[str]:
    """A warning for each element that is cut so that it has no body; `factorize.segment` tells which objects are cut.

    Args:
        elements: Elements of the photograph.
        size: Its width and height [px].
    """
    for element in elements:
        if element.cut and element.box and not element.interactive:
            yield (
                f"the {listing(sides(element.box, size))} border of the picture cuts the {element.phrase} in the box "
                f"{list(element.box)}, and too little of it is in view to make a body: it stays in the background; "
                "move the camera to see it whole"
            )
