"""Things that stand flush with the side of another are divided at its top."""

from __future__ import annotations

import numpy as np
import pytest

from rules.factorize.regions import grouping, heights, ledges, patches, proposals
from tests.rules.factorize.regions.test_bonds import at, workspace
from tests.tabletops import FINE, Tabletop, box, cylinder, tabletop

RED, BLUE = (0.75, 0.15, 0.1), (0.1, 0.2, 0.7)


def stacked(upper: tuple[float, float, float], back: float = 0.0) -> Tabletop:
    """A can on one end of a box, its front `back` behind that of the box [m]."""
    lower = box(0.14, 0.08, 0.07, BLUE), at(0.0, 0.0)
    return tabletop(lower, (cylinder(0.035, 0.1, upper), at(0.03, -0.005 + back, 0.07)), lens=FINE)


def surfaces_of(shown: Tabletop) -> patches.Surfaces:
    seen = workspace(shown)
    relief = heights.relief(seen)
    return patches.surfaces(relief, relief.raised & relief.over, seen, proposals.colour_lab(seen.pixels))


def test_a_can_flush_with_the_one_below_is_an_object_of_its_own():
    shown = stacked(RED)
    crop = surfaces_of(shown)
    found = patches.patches(crop)
    height, width = found.shape
    true = shown.labels.labels[crop.top :, crop.left :][:height, :width]
    front = 1 + np.bincount(found.ravel())[1:].argmax()
    shares = np.bincount(true[found == front], minlength=3)[1:] / (found == front).sum()
    assert shares.min() > 0.2, "both fronts are one patch"
    parts = grouping.group(crop, found)
    owners = {int(np.bincount(true[parts.labels == n], minlength=3).argmax()): n for n in parts.groups}
    assert sorted(owners) == [1, 2]
    for thing, number in owners.items():
        own = parts.labels == number
        assert (true[own] == thing).mean() > 0.9
        assert own[true == thing].mean() > 0.9


@pytest.mark.parametrize(("upper", "back"), [(BLUE, 0.0), (RED, 0.02)])
def test_a_step_of_one_colour_and_fronts_that_are_apart_are_not_divided(upper, back):
    crop = surfaces_of(stacked(upper, back))
    assert not ledges.divided(crop, patches.patches(crop))[1]
