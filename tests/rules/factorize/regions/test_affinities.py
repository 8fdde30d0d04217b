"""What the network of single pixels is asked, and what it says of groups."""

from __future__ import annotations

import numpy as np
import pytest

from rules.factorize.regions import affinities, bonds, grouping, heights, patches, proposals
from tests.rules.factorize.regions.test_bonds import at, workspace
from tests.tabletops import box, tabletop


def test_log_odds_of_all_pairs_of_pixels_of_two_labels_are_added() -> None:
    labels = np.array([[1, 1, 2, 2], [1, 1, 2, 2], [0, 0, 0, 0]])
    odds = np.zeros((len(affinities.OFFSETS), 3, 4))
    right, far = affinities.OFFSETS.index((0, 1)), affinities.OFFSETS.index((0, 3))
    odds[right], odds[far] = 9.0, -1.0
    said = affinities.between(odds, labels)
    assert set(said) == {(1, 2)}
    # Of neighbours: two to the right, and one on each diagonal; three apart: two to the right.
    assert said[1, 2][1].tolist() == [4, 2, 0, 0]
    assert said[1, 2][0].tolist() == [2 * affinities.MOST, -2.0, 0.0, 0.0]


def test_labels_of_a_crop_are_found_at_the_pixels_of_the_answer() -> None:
    answer = affinities.Answer(np.zeros((1, 5, 6)), 4)
    labels = np.arange(1, 13).reshape(3, 4)
    found = answer.sampled(labels, 7, 3, 2)
    # Rows of the answer are at 3, 7, 11, 15, 19 px: the first two are in blocks 0 and 2 of the crop, that starts at 3.
    assert found.tolist() == [[0, 1, 3, 0, 0, 0], [0, 9, 11, 0, 0, 0], *[[0] * 6] * 3]


def test_a_picture_far_larger_than_those_of_training_is_reduced() -> None:
    assert [affinities.stride(focal) for focal in (200.0, 300.0, 614.4, 1228.8)] == [1, 1, 2, 4]


def test_other_weights_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    affinities._network.cache_clear()
    monkeypatch.setattr(affinities, "DIGEST", "0" * 64)
    with pytest.raises(ValueError, match="affinities.onnx has other weights"):
        affinities._network()


@pytest.mark.medium
def test_two_boxes_that_touch_are_two_for_the_network_and_each_is_one() -> None:
    pair = [
        (box(0.08, 0.06, 0.1, (0.7, 0.2, 0.2)), at(-0.041, 0.0)),
        (box(0.08, 0.1, 0.07, (0.2, 0.3, 0.7)), at(0.041, 0.0)),
    ]
    shown = tabletop(*pair)
    seen = workspace(shown)
    relief, lab = heights.relief(seen), proposals.colour_lab(seen.pixels)
    answer = affinities.ask(seen, relief, lab)
    crop = patches.surfaces(relief, relief.raised & relief.over, seen, lab, answer)
    left = crop.points[..., 0] < 0.0
    halves = np.where(crop.raised, np.where(left, 1, 2), 0)
    apart = crop.said(halves)[1, 2]
    lower = np.where(crop.raised & left, np.where(crop.points[..., 2] < 0.06, 1, 2), 0)
    one = crop.said(lower)[1, 2]
    assert bonds.means(apart)[1] < 0.0 < bonds.means(one)[1]
    assert len(grouping.group(crop, patches.patches(crop)).groups) >= 2
