"""Speed of the tracker for four objects before a moving camera, beside Open3D's ICP in the same loop.

Processor time is compared, which does not depend on what else runs. `python -m tests.benchmarks.tracking` prints the
whole table; the kitchen table needs `shared/captures`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests import factories
from tests.benchmarks.tracking import judged, kitchen, things
from tests.benchmarks.tracking.scene import Actor, Sequence, before, frames, standing

pytestmark = pytest.mark.slow


def four() -> Sequence:
    """Two printed boxes, a chest and a bowl before a camera that moves around them."""
    links, joints = things.chest()
    bowl = factories.bowl_asset().body.links["base"].mesh
    actors = {
        "tall": Actor({"base": things.carton((0.06, 0.05, 0.14), 1)}, lambda time: standing(-0.2, 0.0, 20)),
        "flat": Actor({"base": things.carton((0.12, 0.09, 0.04), 2)}, lambda time: standing(0.0, -0.08, -10)),
        "bowl": Actor({"base": bowl}, lambda time: standing(0.05, 0.14)),
        "chest": Actor(links, lambda time: standing(0.22, 0.02, -20), joints, lambda time: np.array([0.3 * time])),
    }
    return Sequence("four", actors, lambda time: before(heading_deg=15 * time), 1.0, 20.0)


def test_four_objects_are_tracked_in_a_few_times_the_time_of_icp() -> None:
    rows, times = judged.judge(four(), frames(four()), icp=True)
    print(f"tracker {1e3 * times.tracker:.0f} ms, Open3D's ICP {1e3 * times.icp:.0f} ms per frame")
    assert times.tracker < 5 * times.icp
    assert all(row.status == "tracked" and row.adds < 0.005 for row in rows)


def test_worse_frames_cost_accuracy_and_not_the_object() -> None:
    from tests.benchmarks.tracking.scene import Strain

    made = replace(four(), seconds=0.8)
    rows, _ = judged.judge(made, frames(made, strain=Strain(rate=10, noise=2, shift_px=2)), icp=False)
    assert all(row.status == "tracked" and row.adds < 0.01 for row in rows)


def test_things_on_a_kitchen_table_are_where_the_camera_says(tmp_path: Path) -> None:
    """In 9 of 24 views of the patterned cup the depth contradicts the stated motion, by up to 55 mm: not counted."""
    if not kitchen.CAPTURE.is_dir():
        pytest.skip("needs shared/captures/kitchen_table")
    for name, rows in kitchen.measured(tmp_path / "store").items():
        tracked = [row for row in rows if row.status == "tracked" and row.confirmed]
        assert len(tracked) >= 10, name
        assert np.median([row.off for row in tracked]) < 0.02, name
        assert np.degrees(np.median([row.tilt for row in tracked])) < 5, name
        assert max(row.off for row in tracked) < 0.04, name
