"""How masks of drawn photographs are judged."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.drawn_masks import judge


def test_found_merged_split_and_missed_objects_are_told_apart() -> None:
    true = np.zeros((10, 50), np.int32)
    names = {"whole": 1, "one": 2, "other": 3, "halved": 4, "unseen": 5}
    for label in names.values():
        true[:, 10 * label - 10 : 10 * label] = label
    shown = np.zeros_like(true)
    shown[:, 0:9] = 1
    shown[:, 10:30] = 2  # two things of one size: neither half is the mask of one
    shown[:, 30:34], shown[:, 34:38] = 3, 4
    told = judge(true, names, {*names} - {"other"}, shown, 4)
    assert told.iou == {"whole": pytest.approx(0.9), "one": 0.5, "halved": 0.0, "unseen": 0.0}
    assert told.kinds == {"halved": "split", "unseen": "nothing"}
    assert told.spurious == 2
    shown[:, 38:40] = 2
    told = judge(true, names, {*names}, shown, 4)
    assert told.kinds["one"] == told.kinds["other"] == "merged"
    assert told.spurious == 3
