"""Starts of two slabs: one of them has the hinge's height, from whichever side a lid is seen."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects.view import Seen
from rules.factorize.joints import slab_starts
from rules.factorize.shapes import evidence
from tests.benchmarks.joints.one_capture import opened


@pytest.mark.medium
@pytest.mark.parametrize("kind", ["laptop", "box_with_lid"])
@pytest.mark.parametrize("side", [20, 90, 140, 170])
@pytest.mark.parametrize("seed", [21, 23])
def test_a_start_is_near_the_hinge_of_an_overhanging_lid(kind: str, side: int, seed: int) -> None:
    """The base's back is within the noise of the lid's plane, and only a strip of it is seen from behind."""
    thing, _, instance = opened(kind, seed, 105, side)
    seen = evidence.gather(Seen(instance.view, instance.measured).upright())
    height = thing.joints[0].origin[2]
    right = [start for start in slab_starts.starts(seen) if abs(np.degrees(start[8]) - 105) < 3]
    assert min(abs(start[5] - height) for start in right) < 0.006


def test_starting_heights_are_apart() -> None:
    _, _, instance = opened("laptop", 21, 60, 20)
    seen = evidence.gather(Seen(instance.view, instance.measured).upright())
    heights = {float(start[5]) for start in slab_starts.starts(seen) if abs(np.degrees(start[8]) - 60) < 3}
    assert len(heights) > 1
    assert np.diff(sorted(heights)).min() > slab_starts.APART_M
