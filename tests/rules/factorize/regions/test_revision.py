"""Groups are divided where both whole parts speak for two objects, and left whole where they are one."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import transforms
from rules.factorize.regions import grouping, heights, patches, proposals, revision
from rules.factorize.regions.partition import Grouping
from rules.reference import solids
from tests.rules.factorize.regions.test_bonds import at, workspace
from tests.tabletops import FINE, Tabletop, box, cylinder, iou, revolved, tabletop

Thing = list[tuple[Mesh, np.ndarray]]
WHITE = (0.85, 0.85, 0.8)


def leaning(angle_deg: float) -> np.ndarray:
    """A slab 0.14 m high that leans against the wall x = 0 of a box."""
    angle = np.radians(angle_deg)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return transforms.rigid(turn, np.array([-0.075, 0.0, 0.01]))


def mug(handle: tuple[float, float, float]) -> Thing:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 14)
    path = np.c_[0.038 + 0.03 * np.cos(angle), np.zeros(14), 0.045 + 0.03 * np.sin(angle)]
    picture = np.full((8, 8, 3), np.round(255 * np.array(handle)), np.uint8)
    cup = revolved([(0.0, 0.0), (0.036, 0.0), (0.04, 0.09), (0.036, 0.09), (0.032, 0.005), (0.0, 0.005)], WHITE)
    return [(cup, at(0, 0)), (solids.tube(path, 0.007, 0.006, picture, 12), at(0, 0))]


def drill() -> Thing:
    """A horizontal body on an upright grip: an L."""
    colour = (0.85, 0.75, 0.1)
    return [(box(0.16, 0.05, 0.05, colour), at(0.04, 0.0, 0.11)), (box(0.045, 0.045, 0.115, colour), at(0.0, 0.0))]


def cans(gap: float) -> Thing:
    colours = ((0.75, 0.15, 0.1), (0.8, 0.3, 0.15))
    return [
        (cylinder(0.034, 0.1, own), at(side * (0.034 + gap / 2), 0.0))
        for side, own in zip((-1, 1), colours, strict=True)
    ]


def joined(shown: Tabletop, owners: tuple[int, ...]) -> tuple[Grouping, np.ndarray]:
    """One group of all patches above the table; first those of one object were joined.

    Args:
        shown: The picture.
        owners: The object of each thing.

    Returns:
        The group, and the true object (h, w) of each pixel of the crop.
    """
    seen = workspace(shown)
    relief = heights.relief(seen)
    crop = patches.surfaces(relief, relief.raised & relief.over, seen, proposals.colour_lab(seen.pixels))
    parts = Grouping(crop, patches.patches(crop))
    height, width = crop.height.shape
    true = np.array([0, *owners])[shown.labels.labels[crop.top :, crop.left :][:height, :width]]
    owner = {n: int(np.bincount(true.ravel()[patch.pixels]).argmax()) for n, patch in parts.groups.items()}
    for numbers in ([n for n in sorted(owner) if owner[n] == one] for one in sorted(set(owner.values()))):
        for number in numbers[1:]:
            parts.join(numbers[0], number)
    while len(parts.groups) > 1:
        parts.join(*sorted(parts.groups)[:2])
    return parts, true


@pytest.mark.parametrize(
    "things",
    [
        pytest.param(cans(0.0005), id="two cans in contact"),
        pytest.param(
            [(box(0.1, 0.1, 0.12, (0.2, 0.3, 0.7)), at(0, 0)), (box(0.012, 0.09, 0.14, (0.8, 0.6, 0.2)), leaning(9.0))],
            id="a box leaning on a box",
        ),
    ],
)
def test_two_objects_that_were_joined_are_divided(things: Thing) -> None:
    parts, true = joined(tabletop(*things, lens=FINE), (1, 2))
    revision.divide_doubted(parts)
    large = [number for number, one in parts.groups.items() if one.area_m2 > grouping.SLIVER_M2]
    assert len(large) == 2
    for number in large:
        assert max(iou(parts.labels == number, true == one) for one in (1, 2)) > 0.85


@pytest.mark.parametrize(
    "things",
    [
        pytest.param(mug((0.1, 0.2, 0.6)), id="a mug and its handle of another colour"),
        pytest.param(drill(), id="a drill"),
    ],
)
def test_one_object_of_two_parts_stays_whole(things: Thing) -> None:
    parts, _ = joined(tabletop(*things, lens=FINE), (1, 1))
    revision.divide_doubted(parts)
    assert len(parts.groups) == 1


def test_a_divided_grouping_is_that_of_its_patches() -> None:
    """Dividing undoes a join: labels, members and contacts are those before."""
    parts, _ = joined(tabletop(*cans(0.0005), lens=FINE), (1, 2))
    (number,) = parts.groups
    first, second = parts.joins[-1]
    ends = parts.part(number, first)
    assert {frozenset(parts.members[end]) for end in ends} == {first, second}
    for end in ends:
        assert (parts.labels.ravel()[parts.groups[end].pixels] == end).all()
        assert len(parts.groups[end].pixels) == sum(len(parts.patches[n].pixels) for n in parts.members[end])
    assert parts.contact(*ends) == parts.contact_of(first, second)
    assert parts.join(*ends) == number
    assert parts.contacts == {}
