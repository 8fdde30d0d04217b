"""Quarter turns of pictures, boxes and cameras agree with one another."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import cameras, transforms, upright
from tests import factories


@pytest.mark.parametrize("count", range(-3, 5))
def test_a_turned_camera_sees_the_turned_picture(count):
    lens = factories.camera(64, 48)
    depth = np.random.default_rng(0).uniform(0.5, 1.0, (48, 64))
    points = cameras.backproject(depth, lens.matrix())
    turned = cameras.backproject(upright.turned(depth, count), lens.turned(count).matrix())
    expected = transforms.apply(upright.turned_from_camera(count), upright.turned(points, count))
    assert np.abs(turned - expected).max() < 1e-12
    assert (lens.turned(count).height, lens.turned(count).width) == upright.turned(depth, count).shape


@pytest.mark.parametrize("count", range(4))
def test_a_turned_box_holds_the_same_pixels(count):
    mask = np.zeros((48, 64), bool)
    mask[5:11, 20:50] = True
    left, top, right, bottom = upright.turned_box((20, 5, 50, 11), (64, 48), count)
    turned = upright.turned(mask, count)
    assert turned[top:bottom, left:right].all()
    assert turned.sum() == (right - left) * (bottom - top)
    size = (turned.shape[1], turned.shape[0])
    assert upright.turned_box((left, top, right, bottom), size, -count) == (20, 5, 50, 11)


@pytest.mark.parametrize("count", range(4))
def test_the_turns_are_read_from_the_pose(count):
    pose = factories.look_at((0.1, -0.7, 0.5))
    # A camera that was turned the other way needs this turn to be upright.
    assert upright.turns(pose @ upright.turned_from_camera(count)) == count
